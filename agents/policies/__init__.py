"""Policies: what acts in the environments, and the registry that names them."""
