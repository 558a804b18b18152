"""One YAML file to validated, frozen models; all errors of a file at once."""
