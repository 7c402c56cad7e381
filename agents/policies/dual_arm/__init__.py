"""Policies of the dual-arm robots."""
