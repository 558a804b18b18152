"""Command line ``dctorque``: one file per subcommand, a few lines each."""
