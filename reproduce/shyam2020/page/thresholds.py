"""Thresholds by which the claims of shyam2020 are decided."""

from math import radians

MUCH = 0.9  # of another's cost or attitude, below which it counts as lower
NEAR = 1.05  # of the least cost known, up to which a cost counts as the minimum
SAME = 2e-3  # relative; costs that differ by less are equal: one is read off splines, one off samples
MET = (1e-3, radians(0.05))  # m and rad, of an end-effector that meets its goal
ENVELOPE = (0.05, radians(5.0))  # m and rad, within which the suite's target is captured
KEPT = radians(0.05)  # rad, of an attitude that is kept
NEVER = radians(0.001)  # rad, of a satellite that is not rotated at any instant
FAST = 0.1  # of optimal control's planning time
PERIOD = 0.1  # s, a control period of the suite
COMPACT = 0.01  # of the largest joint displacement, error of a motion in the ProMP's weights
OFTEN = 0.01  # relative, by which a single start costs more if it is stuck
BEST_TENTH = 0.1
