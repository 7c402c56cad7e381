"""Robots: values, descriptions, models and export."""
