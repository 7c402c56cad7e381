"""Differences between the robot that is simulated and the nominal model that policies know."""
