"""Robots: the papers' tables as parameters, the MuJoCo models made of them, and how they look."""
