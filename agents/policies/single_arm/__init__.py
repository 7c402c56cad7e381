"""Policies of the single arm."""
