"""Motions of one arm that never rotate the base: paths in the reaction null space, and their timing."""
