"""Scenery, which is only drawn: satellites, arms, targets, the planet and the stars."""
