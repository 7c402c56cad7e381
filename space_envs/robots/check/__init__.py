"""The check of a robot: measured figures, what looks implausible, and the suite's tests on it."""
