"""Inequalities of motions in weight space, as rows of the quadratic program at times when they are close."""
