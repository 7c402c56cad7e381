"""Optimisation in the weights of a movement primitive."""
