"""Thresholds by which the claims of shah2013 are decided."""

SAME = 1e-9  # relative; energies that differ by less are equal
MUCH = 0.9  # of another's energy or power, below which it counts as much lower
SUDDEN = 4.0  # times its mean, from which the fastest change of zeta counts as sudden
LATE = 0.75  # of the duration
ORDER = 1e-8  # rad/s, below which a base rate is of the paper's order, 1e-9 rad/s
ARRIVED = 1e-6  # m and m/s
HARDLY = 1e-6  # rad/s, of a simulated base
PRINTED = 18.0, 0.5  # s, when the paper has the sudden change, and the largest difference that counts as none
