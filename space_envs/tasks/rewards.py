"""Reward terms: pure functions of the quantities of one control period, one row each with its weight.

The terms that shape the reward are changes of a potential, with discount 1: their sum over an episode is the
difference between its last and its first state, whatever lies between, so that haste is not rewarded. At a
capture every potential is 0, its value at the goal; at any other end it is that of the last state. So shaping
gives all captures of a goal the same sum, and a failure the more the nearer it ends to the goal.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from space_envs.checks import number
from space_envs.dynamics.rotations import Array
from space_envs.errors import ConfigurationError, shown, unknown_name
from space_envs.tasks.common import CaptureErrors, CaptureLimits, ObservationLayout
from space_envs.tasks.outcome import kept_attitude

COUNTED = ("second", "once", "change")


class StepQuantities(NamedTuple):
    """Quantities of one control period of N episodes, the arguments of reward terms.

    Attributes:
        observation, previous: (N, size) at the end and at the beginning of the period.
        action: (N, m) in [-1, 1].
        errors: of the capture, at the end. attitude: (N,) rad from the initial attitude, at the end.
        captured, failed: (N,) bool, true in the period in which the episode ends with that outcome.
        layout: of the observations. limits: of the capture envelope.
        beginning: quantities of the state at the beginning of the period, None for a state alone.
    """

    observation: Array
    previous: Array
    action: Array
    errors: CaptureErrors
    attitude: Array
    captured: NDArray[np.bool_]
    failed: NDArray[np.bool_]
    layout: ObservationLayout
    limits: CaptureLimits
    beginning: "StepQuantities | None" = None

    def read(self, name: str) -> Array:
        """View (N, k) of a field of the observation; errors as in `ObservationLayout.read`."""
        return self.layout.read(self.observation, name)


@dataclass(frozen=True)
class RewardTerm:
    """One term of a reward, named as in `info["reward_terms"]`.

    Attributes:
        name: of the term. function: from the quantities of a period to values (N,), which are weighted.
        weight: negative for a penalty.
        per: `second`, multiplied by the control period; `once`; or `change`, the difference of a potential
            between the end and the beginning of the period. The potential is 0 at a capture.
    """

    name: str
    function: Callable[[StepQuantities], Array]
    weight: float
    per: str = "second"

    def __post_init__(self) -> None:
        number(f"weight of reward term {shown(self.name)}", self.weight)
        if not callable(self.function):
            raise ConfigurationError(
                f"reward term {shown(self.name)} must have a function, got {shown(self.function)}"
            )
        if self.per not in COUNTED:
            raise unknown_name("counting of a reward term", self.per, COUNTED)

    def rate(self, period: float) -> float:
        """Weight of a value in one control period, s."""
        return period * self.weight if self.per == "second" else self.weight


def base_disturbance(step: StepQuantities) -> Array:
    """c^2 w.w + v.v of the satellite, the integrand of eq. 20 of shyam2020, m^2/s^2."""
    return step.errors.base_speed * step.errors.base_speed


def attitude_angle(step: StepQuantities) -> Array:
    """Angle of the satellite from its initial attitude, rad."""
    return step.attitude


def position(step: StepQuantities) -> Array:
    """Distance of the end-effector from its grapple, m."""
    return step.errors.position


def orientation(step: StepQuantities) -> Array:
    """Angle of the end-effector from its grapple, rad."""
    return step.errors.orientation


def precision(step: StepQuantities) -> Array:
    """1 - exp(-r), r the larger ratio of position and angle to their limits in the capture envelope."""
    errors, limits = step.errors, step.limits
    ratio = np.maximum(errors.position / limits.position, errors.orientation / limits.orientation)
    return -np.expm1(-ratio)


def effort(step: StepQuantities) -> Array:
    """Mean squared action."""
    return (step.action * step.action).sum(axis=1) / step.action.shape[1]


def capture(step: StepQuantities) -> Array:
    """1 / (1 + peak attitude / 1 deg) in the control period that completes a capture, the score."""
    return kept_attitude(step.captured, np.rad2deg(step.read("peak_attitude")[:, 0]))


def failed(step: StepQuantities) -> Array:
    """1 on a failure: attitude lost, collision, simulation diverged."""
    return step.failed.astype(np.float64)


_ATTITUDE = RewardTerm("attitude", base_disturbance, -1.0)
_CAPTURE = RewardTerm("capture", capture, 10.0, "once")
_FAILURE = RewardTerm("failure", failed, -0.5, "once")
DENSE = (
    _ATTITUDE,
    RewardTerm("attitude_angle", attitude_angle, -0.1),
    RewardTerm("position", position, -0.5, "change"),
    RewardTerm("orientation", orientation, -0.25, "change"),
    RewardTerm("precision", precision, -0.5, "change"),
    RewardTerm("effort", effort, -0.02),
    _CAPTURE,
    _FAILURE,
)
SPARSE = (_ATTITUDE, _CAPTURE, _FAILURE)
