"""Gauss collocation of motions along prescribed end-effector paths."""
