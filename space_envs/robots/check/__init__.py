"""The check of a robot: its figures, measured, what looks implausible, and the suite's physics tests on it."""
