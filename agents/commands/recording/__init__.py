"""Datasets: requests for them, and their recording."""
