"""Planners of the single arm in the weights of ProMPs."""
