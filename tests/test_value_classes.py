"""Value classes and constructors at public boundaries: what is no value of a field is refused by name.

A field that is a number gets text, flags, NaN, infinity, lists; a flag gets "no"; an array gets other shapes.
Every such call ends in the package's own error, never in a raw one, and never in silence.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from offenders import assert_none

from agents.demonstrations.optimal.library import LibraryRecipe
from agents.demonstrations.variations import DemonstratorConfig
from agents.planners.common.plans import Limits
from agents.planners.dual_arm.free_paths.planner import plan_free
from agents.planners.dual_arm.prescribed_paths import instantaneous
from agents.planners.dual_arm.prescribed_paths import ocp as reactionless_ocp
from agents.planners.dual_arm.problem import Capture
from agents.planners.dual_arm.surroundings import Surroundings
from agents.planners.dual_arm.tracking import Tracking
from agents.planners.single_arm.collocation.ocp import plan_ocp
from agents.planners.single_arm.nmpc.controller import Controller
from agents.planners.single_arm.nmpc.problem import Weights
from agents.planners.single_arm.problem import Reach
from agents.planners.single_arm.promp.optimal import OptimalPlanner
from agents.planners.single_arm.weights.legendre import LegendreBasis
from agents.planners.single_arm.weights.task_space import PoseTarget
from agents.policies.single_arm.stochastic_feedback import StochasticFeedback
from promp import GaussianBasis, ProMP, PrompError, ViaPoint, regress_weights
from promp.nonlinear import NonlinearTarget, condition_nonlinear
from space_envs.dynamics.grapples import Grapple
from space_envs.errors import ConfigurationError
from space_envs.registration import make_task
from space_envs.robots.models import SceneOptions, robot_model
from space_envs.robots.zoo import find_robot
from space_envs.tasks.rewards import RewardTerm
from space_envs.tasks.single_arm import PoseEnvelope

ARM = make_task("SpaceCapture/SingleArm-v0", {}).mechanics
ARMS = make_task("SpaceCapture/DualArmPlanar-v0", {}).mechanics
GRAPPLE = Grapple.at_rest(np.ones(3), np.array([1.0, 0.0, 0.0, 0.0]))
REACH = Reach(ARM.home, GRAPPLE, 10.0, np.zeros(7))
REST = Capture(ARMS.home, 20.0, Grapple.at_rest(np.ones((2, 3)), np.array([1.0, 0.0, 0.0, 0.0])))
PROMP = ProMP(np.zeros((2, 10)), 0.01 * np.eye(20))
MODEL = robot_model(find_robot("shyam2020"))

ODD = st.sampled_from(
    ["no", "", b"1", True, False, 1j, [1.0], [], {}, float("nan"), float("inf"), -float("inf"), object()]
)  # fmt: skip
NO_NUMBER = ODD
NEGATIVE = ODD | st.floats(max_value=-1e-6) | st.integers(max_value=-1)
NOT_POSITIVE = NEGATIVE | st.sampled_from([0, 0.0, -0.0])
NO_JOINT_LIMIT = NOT_POSITIVE.filter(lambda value: value != [1.0]) | st.sampled_from(
    [[0.3, 0.0], [0.3, np.inf], [[0.3]], []]
)
NO_COUNT = NOT_POSITIVE | st.sampled_from([1.5, 2.0, 10**400])
NO_FLAG = st.sampled_from(["no", "", 0, 1, 1.0, np.nan, [True], {}])
NO_RANGE = st.sampled_from([1.0, (1.0,), (2.0, 1.0), ("a", "b"), (-1.0, 1.0)])
NO_SIZE = NEGATIVE | st.sampled_from([1.5, 2.0, 10**400])
NO_TABLE = st.sampled_from(["no", [[1.0], [1.0, 2.0]], np.full(7, np.nan), np.full(7, "1"), np.full(7, 1j)])
NO_ARRAY = NO_TABLE | st.sampled_from([5.0, [], np.ones((5, 4))])


def each(build: Callable[..., Any], names: str, values: Any) -> list[tuple[Callable[..., Any], str, Any]]:
    """One case for each of the keywords `names`, separated by blanks."""
    return [(build, name, values) for name in names.split()]


def grapple(**values: Any) -> Grapple:
    return replace(GRAPPLE, **values).checked()


def reach(**values: Any) -> Reach:
    return replace(REACH, **values).checked(ARM)


def capture(**values: Any) -> Capture:
    return replace(REST, **values).checked(ARMS)


def ocp(**values: Any) -> Any:
    return plan_ocp(MODEL, ARM, REACH, Limits(), **values)


def planner(**values: Any) -> OptimalPlanner:
    return OptimalPlanner(ARM, **values)


def controller(**values: Any) -> Controller:
    return Controller(ARM, Limits(), **values)


def free(**values: Any) -> Any:
    return plan_free(ARMS, REST, **values)


def rested(**values: Any) -> Any:
    return reactionless_ocp.plan_ocp(ARMS, REST, **values)


def feedback(**values: Any) -> StochasticFeedback:
    return StochasticFeedback.of(PROMP, **{"duration": 1.0, "period": 0.1, **values})


def target(**values: Any) -> PoseTarget:
    return PoseTarget(ARM, GaussianBasis(), **{"duration": 1.0, "position": np.ones(3), **values})


def recipe(**values: Any) -> LibraryRecipe:
    return LibraryRecipe(
        **{"robot": find_robot("shyam2020"), "keep_attitude": True, "limited": True, **values}
    )


def reward_term(**values: Any) -> RewardTerm:
    return RewardTerm(**{"name": "speed", "function": np.abs, **values})


def promp(**values: Any) -> ProMP:
    return ProMP(**{"mean": np.zeros((2, 10)), "covariance": np.eye(20), **values})


def sampled(**values: Any) -> Any:
    return PROMP.sample(np.random.default_rng(0), **values)


def via_point(**values: Any) -> ProMP:
    given = {"phase": 0.5, "position": np.zeros(2), "velocity": np.zeros(2), "duration": 1.0}
    return PROMP.condition_on([ViaPoint(**{**given, **values})])


def regressed(**values: Any) -> Any:
    given = {"positions": np.zeros((1, 20, 2)), "velocities": np.zeros((1, 20, 2)), "duration": 1.0}
    return regress_weights(**{**given, "basis": GaussianBasis(), **values})


def conditioned(**values: Any) -> Any:
    asked = NonlinearTarget(lambda w: (w[:, 0, :1] - 0.1, np.eye(20)[None, :1]))
    return condition_nonlinear(PROMP, asked, **values)


CASES = [
    *each(Limits, "rate acceleration torque coriolis", NO_JOINT_LIMIT),
    *each(Limits, "control", NOT_POSITIVE),
    *each(Limits, "position", NO_ARRAY | st.sampled_from([np.array([[1.0, 0.0]]), np.full((7, 2), np.nan)])),
    *each(reach, "duration c", NOT_POSITIVE),
    *each(
        grapple, "centre attitude linear_velocity angular_velocity inertia offset orientation", NO_ARRAY
    ),
    *each(grapple, "attitude orientation", st.just(np.zeros(4))),
    *each(grapple, "inertia", st.sampled_from([np.array([1.0, 0.0, 1.0]), np.array([1.0, -1.0, 1.0])])),
    *each(reach, "start goal", NO_ARRAY),
    *each(reach, "window", NO_ARRAY | st.sampled_from([(2.0, 1.0), (0.0, 1.0), (1.0, np.inf)])),
    *each(reach, "rate", NO_ARRAY),
    *each(reach, "spheres", NO_TABLE | st.sampled_from([np.zeros((2, 4)), np.ones((2, 3))])),
    *each(reach, "keep_attitude", NO_FLAG),
    *each(capture, "duration", NOT_POSITIVE),
    *each(capture, "start goals", NO_ARRAY),
    *each(capture, "aligned", NO_FLAG),
    *each(Surroundings, "radius", NOT_POSITIVE),
    *each(Surroundings, "margin gripper contact", NEGATIVE),
    *each(Surroundings, "standing", NO_SIZE),
    *each(Surroundings, "arms", NO_FLAG),
    *each(Surroundings, "bus", NO_ARRAY),
    *each(Tracking, "timestep control_period", NOT_POSITIVE),
    *each(Tracking, "joint_gain attitude_gain", NEGATIVE),
    *each(Weights, "duration latest shortest late damping", NOT_POSITIVE),
    *each(Weights, "goal attitude_end attitude_late attitude", NEGATIVE),
    *each(Weights, "iterations", NO_COUNT),
    *each(controller, "c", NOT_POSITIVE),
    *each(planner, "candidates improved", NO_COUNT),
    *each(ocp, "starts", NO_COUNT),
    *each(free, "starts", NO_COUNT),
    *each(rested, "from_rest", NO_FLAG),
    *each(feedback, "duration period", NOT_POSITIVE),
    *each(feedback, "position_noise rate_noise", NEGATIVE),
    *each(target, "duration phase", NOT_POSITIVE),
    *each(target, "position rotation attitude", NO_ARRAY),
    *each(LegendreBasis, "size", NO_COUNT),
    *each(recipe, "keep_attitude limited", NO_FLAG),
    *each(DemonstratorConfig, "dt", NOT_POSITIVE),
    *each(DemonstratorConfig, "per_goal", NO_COUNT),
    *each(DemonstratorConfig, "redundancy offset noise noise_free rest weight_decades", NEGATIVE),
    *each(DemonstratorConfig, "ramp radius", NO_RANGE),
    *each(SceneOptions, "timestep", NOT_POSITIVE),
    *each(SceneOptions, "visual", NO_FLAG),
    *each(SceneOptions, "obstacles", NO_SIZE),
    *each(PoseEnvelope, "position linear_velocity hold orientation angular_velocity", NOT_POSITIVE),
    *each(reward_term, "weight", NO_NUMBER),
    *each(GaussianBasis, "bandwidth", NOT_POSITIVE),
    *each(GaussianBasis, "centres", NO_TABLE),
    *each(promp, "mean covariance basis", NO_ARRAY),
    *each(sampled, "n", NEGATIVE | st.just(1.5)),
    *each(via_point, "phase duration", NEGATIVE),
    *each(via_point, "position velocity dofs covariance", NO_ARRAY),
    *each(via_point, "accuracy velocity_accuracy", NEGATIVE.filter(lambda value: value not in ([1.0], []))),
    *each(regressed, "positions velocities phase", NO_ARRAY),
    *each(regressed, "ridge", NEGATIVE),
    *each(regressed, "exact_ends", NO_FLAG),
    *each(conditioned, "tolerance", NOT_POSITIVE),
    *each(conditioned, "iterations", NO_COUNT),
]  # fmt: skip


def accepted(build: Callable[..., Any], name: str, values: Any) -> str | None:
    """A value that was not refused by an error of the project, or None."""

    @settings(max_examples=40)
    @given(value=values)
    def refused(value: Any) -> None:
        try:
            build(**{name: value})
        except (ConfigurationError, PrompError):
            return
        raise AssertionError(f"accepts {value!r}")

    try:
        refused()
    except Exception as error:
        return f"{type(error).__name__}: {error}"
    return None


def test_values_without_meaning_are_refused() -> None:
    found = [(build.__qualname__, name, accepted(build, name, values)) for build, name, values in CASES]
    assert_none(f"{build}, {name}: {value}" for build, name, value in found if value)


@pytest.mark.parametrize("method", ["zeta_zero", "local"])
def test_limits_of_another_robot_are_refused(method: str) -> None:
    limits = Limits(position=np.tile([-1.0, 1.0], (3, 1)))
    with pytest.raises(ConfigurationError, match=r"limits of rate are of 3 joints, the robot has 7"):
        OptimalPlanner(ARM, Limits(rate=np.full(3, 0.3)))
    calls = [
        lambda: OptimalPlanner(ARM, limits),
        lambda: Controller(ARM, limits),
        lambda: plan_ocp(MODEL, ARM, REACH, limits),
        lambda: plan_free(ARMS, REST, limits),
        lambda: reactionless_ocp.plan_ocp(ARMS, REST, limits),
        lambda: getattr(instantaneous, f"plan_{method}")(ARMS, REST, limits),
    ]
    for call in calls:
        with pytest.raises(
            ConfigurationError, match=r"limits of position are of 3 joints, the robot has [67]"
        ):
            call()


def test_limits_are_copies_that_say_what_is_wrong() -> None:
    bounds = np.tile([-1.0, 1.0], (7, 1))
    limits = Limits(position=bounds.tolist(), rate=np.float32(0.5))  # type: ignore[arg-type]
    bounds[0] = 5.0
    assert limits.position[0].tolist() == [-1.0, 1.0] and limits.rate == 0.5
    without_end = Limits(position=np.array([[-np.inf, np.inf]])).position
    assert without_end is not None and without_end.shape == (1, 2)
    with pytest.raises(ConfigurationError, match=r"limit of rate must be a finite positive number, got -1"):
        Limits(rate=-1)
    with pytest.raises(ConfigurationError, match=r"from lowest to highest, got \[1.0, -1.0\] of joint 2"):
        Limits(position=np.array([[0.0, 1.0], [1.0, -1.0]]))
