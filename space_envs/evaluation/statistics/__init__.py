"""Intervals, leaderboards and comparisons of policies from records."""
