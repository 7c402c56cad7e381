"""Optimal motions of one free-floating arm: by collocation, in the weights of a ProMP, in closed loop."""
