"""Nonlinear model predictive control of the single arm: a shrinking horizon in the weights of a ProMP."""
