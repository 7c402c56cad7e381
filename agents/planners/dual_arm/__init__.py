"""Reactionless capture by two arms (shah2013)."""
