"""Planners of the single arm: optimal control, ProMP weights and receding horizons."""
