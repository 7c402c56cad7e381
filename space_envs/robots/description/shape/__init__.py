"""Shapes of arms for contacts."""
