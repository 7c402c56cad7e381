"""Largest time steps and control periods of a robot, measured with motions that ask the most of both."""
