"""Optimal control by direct collocation."""
