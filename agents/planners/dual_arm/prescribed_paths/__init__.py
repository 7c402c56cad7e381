"""Reactionless motions along prescribed end-effector paths (shah2013)."""
