"""Leaderboards: figures, rows and columns of policies on tasks, and policies against each other."""
