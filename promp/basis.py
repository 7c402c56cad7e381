"""Gaussian radial basis functions of the phase (shyam2020, appendix I)."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from promp.checks import Array, finite_array, number, phase_array

PAPER_CENTRES = (-0.142, 0.0, 0.142, 0.285, 0.428, 0.571, 0.714, 0.857, 1.0, 1.142)

# The paper does not give h. The spacing of its centres keeps the regression well conditioned (over positions
# and velocities of 100 points in 10 s, cond(Psi' Psi) = 84) and follows a minimum-jerk motion within 3e-4 of
# its amplitude (rms). Narrower functions (h = 0.1) leave gaps: 30 times the error. Wider ones (h = 0.3) fit
# no better and are nearly dependent: cond 2e7. tests/test_promp_basis.py measures all of these.
PAPER_BANDWIDTH = 0.143


@dataclass(frozen=True)
class GaussianBasis:
    """psi_i(z) = exp(-(z - c_i)^2 / h^2), not normalised (shyam2020, appendix I).

    Args:
        centres: c (nb,), phases; those outside [0, 1] carry the ends of the motion.
        bandwidth: h, in phase. Note that it is not a standard deviation: there is no factor 2 in the
            exponent.

    Every method takes phases in [0, 1] of any shape S and returns S + (nb,); a phase outside, or NaN, is a
    PrompError. Derivatives are with respect to phase: divide by the duration, once an order, for time.
    """

    centres: tuple[float, ...] = PAPER_CENTRES
    bandwidth: float = PAPER_BANDWIDTH

    def __post_init__(self) -> None:
        centres = finite_array("centres", self.centres, (None,))
        object.__setattr__(self, "centres", tuple(centres.tolist()))
        object.__setattr__(self, "bandwidth", number("bandwidth", self.bandwidth, 0.0, strict=True))
        # An empty basis would pass every later shape check and fit nothing.
        number("number of centres", len(self.centres), 1)

    @property
    def size(self) -> int:
        """Number of basis functions nb."""
        return len(self.centres)

    def _offset(self, phase: ArrayLike) -> Array:
        """(z - c) / h, shape S + (nb,)."""
        return (phase_array(phase)[..., None] - np.array(self.centres)) / self.bandwidth

    def value(self, phase: ArrayLike) -> Array:
        """psi(z)."""
        return np.exp(-(self._offset(phase) ** 2))

    def derivative(self, phase: ArrayLike) -> Array:
        """d psi / dz."""
        offset = self._offset(phase)
        return -2 * offset * np.exp(-(offset**2)) / self.bandwidth

    def second_derivative(self, phase: ArrayLike) -> Array:
        """d2 psi / dz2."""
        offset = self._offset(phase)
        return (4 * offset**2 - 2) * np.exp(-(offset**2)) / self.bandwidth**2
