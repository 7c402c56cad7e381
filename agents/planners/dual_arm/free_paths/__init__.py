"""Reactionless motions whose paths are free between their ends."""
