"""Captures of a pose while the satellite does not turn at any instant."""
