"""Measurements behind the tables in docs/; each module is a command with --help."""
