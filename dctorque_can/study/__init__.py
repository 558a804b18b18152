"""How robust the estimator is: many simulated cars, each a little different from what the estimator believes."""
