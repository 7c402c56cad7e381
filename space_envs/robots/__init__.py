"""Robots: parameters with their sources, and MuJoCo models built from them."""
