"""The observer of Oh, Choi et al. (Mechatronics 2014): sampled form, stability, noise and lag."""
