"""Robots: parameters with their sources, and the MuJoCo models that are built from them."""
