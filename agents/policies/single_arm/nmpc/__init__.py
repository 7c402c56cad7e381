"""Nonlinear model predictive control of the single arm as policies."""
