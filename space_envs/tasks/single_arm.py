"""SpaceCapture/SingleArm: bring the end-effector to a grapple pose that rests in the inertial frame.

The base floats, so where the end-effector arrives depends on the way it takes. A goal is the pose in which a
minimum-jerk joint motion of the free-floating robot ends, from home to a configuration drawn around it: every
goal can be reached. Nothing is touched; to capture is to be close, aligned and slow for long enough.
"""

import math
from dataclasses import dataclass, field, fields
from functools import cached_property, lru_cache

import mujoco
import numpy as np
from numpy.typing import NDArray

from space_envs.dynamics import FloatingRobot, minimum_jerk, roll_out_base
from space_envs.dynamics.rotations import Array, from_matrix, multiply, rotate
from space_envs.errors import ConfigurationError, GoalError, positive, positive_integer, unknown_name
from space_envs.models.parameters import SINGLE_ARM, VARIANTS
from space_envs.models.single_arm import ModelOptions, single_arm_model
from space_envs.tasks.common import (
    DIFFICULTIES,
    REWARDS,
    SPLITS,
    CaptureEnvelope,
    Field,
    Goals,
    ObservationLayout,
)

LAYOUT = ObservationLayout(
    (
        Field("joint_position", 7, 20.0, "joint angles, rad"),
        Field("joint_velocity", 7, 100.0, "joint rates, rad/s"),
        Field("base_position", 3, 10.0, "satellite's centre of mass, inertial frame, m"),
        Field("base_quaternion", 4, 1.0, "satellite's attitude, w x y z, body to inertial"),
        Field("base_linear_velocity", 3, 100.0, "of the satellite's centre of mass, inertial axes, m/s"),
        Field("base_angular_velocity", 3, 100.0, "of the satellite, inertial axes, rad/s"),
        Field("end_effector_position", 3, 10.0, "inertial frame, m"),
        Field("end_effector_quaternion", 4, 1.0, "w x y z, end-effector to inertial; either sign"),
        Field("end_effector_linear_velocity", 3, 100.0, "inertial axes, m/s"),
        Field("end_effector_angular_velocity", 3, 100.0, "inertial axes, rad/s"),
        Field("goal_position", 3, 10.0, "grapple, inertial frame, m"),
        Field("goal_quaternion", 4, 1.0, "grapple, w x y z, grapple to inertial, w >= 0"),
        Field("position_error", 3, 20.0, "goal minus end-effector, inertial axes, m"),
        Field("rotation_error", 3, 3.1416, "rotation vector from end-effector to goal, inertial axes, rad"),
        Field("time", 1, 1e4, "since the start of the episode, s"),
    )
)
_GOAL, _GOAL_TURN, _TIP, _TIP_TURN, _POSITION_ERROR, _ROTATION_ERROR = (
    LAYOUT.slices[name]
    for name in (
        "goal_position",
        "goal_quaternion",
        "end_effector_position",
        "end_effector_quaternion",
        "position_error",
        "rotation_error",
    )
)
_TINY = 1e-300  # keeps 0 / 0 from being NaN
MEASURED = 47  # leading components that are sensors of the model, in its order

# Largest steps of docs/momentum.md whose drift stays well inside the bound, s.
DEFAULT_TIMESTEP = {"paper": 0.02, "physical": 0.01}

# Half-width of the box around home that goal configurations are drawn from, rad.
RADIUS = {"easy": 0.3, "medium": 0.6, "hard": 1.0}
SPLIT_SIZE = {"train": 4096, "validation": 256, "test": 512, "ood": 512}
SPLIT_SEED = {"train": 20_201, "validation": 20_202, "test": 20_203, "ood": 20_204}
OOD_RADIUS = (1.0, 1.3)  # of the difficulty's: the largest joint displacement lies in this range
OOD_MASS = (0.8, 1.2)  # factor on the satellite's mass and inertia
BLOCK = 64  # goals are computed in whole blocks, so that a goal has the same bits whoever asks for it
NODES = 41  # of the minimum-jerk motion whose end defines a goal
CLEARANCE = 0.25  # m, of a goal from the bus
NEAREST = 0.15  # m, least distance of a goal from the end-effector's start


@dataclass(frozen=True)
class RewardWeights:
    """Weights of the reward terms; field names are the names in `info["reward_terms"]`.

    With weight 1 the sum of `attitude` over an episode is minus the cost of eq. 20 of shyam2020 times dt.
    Terms per second are multiplied by the control period.
    """

    attitude: float = 1.0  # -(c^2 w.w + v.v), per s
    attitude_angle: float = 1.0  # -angle of the satellite from its initial attitude in rad, per s
    position: float = 1.0  # -distance to the grapple in m, per s
    orientation: float = 0.5  # -angle to the grapple in rad, per s
    precision: float = 1.0  # exp(-worst ratio of error to envelope), per s
    effort: float = 0.02  # -mean squared action, per s
    capture: float = 10.0  # once, on capture
    failure: float = 20.0  # minus, once, when the attitude is lost or the simulation diverges


SPARSE = RewardWeights(1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 1.0)


@dataclass(frozen=True)
class SingleArmTask:
    """The task's configuration and its pure functions on batched state.

    Attributes:
        difficulty: easy, medium or hard; size of the goal region.
        split: which goals an episode draws from when `reset` does not say.
        reward: dense or sparse.
        variant: inertias of the model, paper or physical.
        control_period: between two actions, s. timestep: of the simulation, s; None takes the variant's own,
            the largest in the table of docs/momentum.md whose drift stays well inside the bound.
        horizon: steps after which an episode is cut.
        envelope: of a capture. attitude_limit: deg from the initial attitude at which it counts as lost.
        c: angular to linear conversion of eq. 20, m/rad.
    """

    difficulty: str = "medium"
    split: str = "train"
    reward: str = "dense"
    variant: str = "paper"
    control_period: float = 0.1
    timestep: float | None = None
    horizon: int = 200
    envelope: CaptureEnvelope = field(default_factory=CaptureEnvelope)
    attitude_limit: float = 45.0
    c: float = 1.0

    def __post_init__(self) -> None:
        for kind, value, valid in (
            ("model variant", self.variant, VARIANTS),
            ("difficulty", self.difficulty, DIFFICULTIES),
            ("split", self.split, SPLITS),
            ("reward", self.reward, REWARDS),
        ):
            if not isinstance(value, str) or value not in valid:
                raise unknown_name(kind, value, valid)
        if self.timestep is not None:
            positive("timestep", self.timestep)
        for name in ("control_period", "attitude_limit", "c"):
            positive(name, getattr(self, name))
        positive_integer("horizon", self.horizon)
        substeps = self.control_period / self.step_size
        if not substeps > 0.5 or abs(substeps - round(substeps)) > 1e-9 * substeps:
            raise ConfigurationError(
                f"control_period must be a multiple of timestep, got {self.control_period!r} and "
                f"{self.step_size!r} s"
            )

    layout = LAYOUT
    parameters = SINGLE_ARM

    @cached_property
    def weights(self) -> RewardWeights:
        """Weights of the reward terms."""
        return RewardWeights() if self.reward == "dense" else SPARSE

    @property
    def step_size(self) -> float:
        """Step of the simulation, s."""
        return DEFAULT_TIMESTEP[self.variant] if self.timestep is None else self.timestep

    @property
    def substeps(self) -> int:
        """Simulation steps per control step."""
        return round(self.control_period / self.step_size)

    @cached_property
    def hold_steps(self) -> int:
        """Control periods that begin and end inside the envelope, in a row, that make a capture."""
        return math.ceil(self.envelope.hold / self.control_period - 1e-9)

    @cached_property
    def attitude_limit_rad(self) -> float:
        """The attitude limit in rad."""
        return float(np.deg2rad(self.attitude_limit))

    @property
    def model(self) -> mujoco.MjModel:
        """The compiled model, shared and read-only."""
        return single_arm_model(ModelOptions(self.variant, self.step_size))

    @property
    def render_model(self) -> mujoco.MjModel:
        """The same model with its drawn geometry."""
        return single_arm_model(ModelOptions(self.variant, self.step_size, visual=True))

    @property
    def robot(self) -> FloatingRobot:
        """The robot's momentum-level mathematics, read from the model."""
        return _robot(self.variant)

    def goals(self, split: str, indices: NDArray[np.int64]) -> Goals:
        """Goals (K) of a split by index; the same for ever, on every machine to rounding.

        Raises:
            ConfigurationError: for an unknown split or an index outside it.
        """
        size = self.split_size(split)
        indices = np.asarray(indices)
        if indices.dtype.kind not in "iu" or (indices < 0).any() or (indices >= size).any():
            raise ConfigurationError(
                f"index of split {split!r} must be an integer in 0..{size - 1}, got {indices.tolist()!r}"
            )
        blocks = [_goal_block(self.variant, self.difficulty, split, int(b)) for b in indices // BLOCK]
        rows = indices % BLOCK
        return Goals(
            position=np.array([b.position[r] for b, r in zip(blocks, rows, strict=True)]),
            quaternion=np.array([b.quaternion[r] for b, r in zip(blocks, rows, strict=True)]),
            mass_scale=np.array([b.mass_scale[r] for b, r in zip(blocks, rows, strict=True)]),
        )

    def split_size(self, split: str) -> int:
        """Number of goals in a split.

        Raises:
            ConfigurationError: for an unknown split.
        """
        if not isinstance(split, str) or split not in SPLITS:
            raise unknown_name("split", split, SPLITS)
        return SPLIT_SIZE[split]

    def check_goals(
        self, position: Array, quaternion: Array, joints: Array | None = None
    ) -> tuple[Array, Array]:
        """Validate grapple poses given by a user; returns them with unit quaternions, w >= 0.

        Args:
            position: (K, 3) m. quaternion: (K, 4). joints: (K, n) rad at the start; None is home.

        Raises:
            GoalError: for NaN, a quaternion that is no rotation, a place out of reach or inside the bus.
        """
        if not (np.isfinite(position).all() and np.isfinite(quaternion).all()):
            raise GoalError("a goal must be finite, got NaN or infinity")
        norm = np.linalg.norm(quaternion, axis=-1, keepdims=True)
        if (abs(norm - 1.0) > 1e-3).any():
            raise GoalError(
                f"goal_quaternion must be a unit quaternion (w, x, y, z), got norm {norm.ravel().tolist()}"
            )
        robot = self.robot
        com = robot.kinematics(robot.home if joints is None else joints).com
        # The base starts at the origin, and with zero momentum the common centre of mass stays where it is.
        centre = (robot.mass[1:] @ com + robot.mass[0] * robot.com[0]) / robot.mass.sum()
        distance = np.linalg.norm(position - centre, axis=-1)
        reach = self.robot.reach()
        if (distance > reach).any():
            raise GoalError(
                f"goal out of reach: {distance.max():.2f} m from the system's centre of mass, the reach is "
                f"{reach:.2f} m"
            )
        if (np.abs(position).max(axis=-1) < SINGLE_ARM.satellite_side / 2).any():
            raise GoalError(f"goal inside the satellite: {position.tolist()} m")
        return position, np.where(quaternion[..., :1] < 0, -quaternion, quaternion) / norm

    @cached_property
    def _squares(self) -> Array:
        """(size, 5) from squared observations to the squares of what `norms` gives."""
        squares = LAYOUT.sum_of_squares(
            "position_error",
            "rotation_error",
            "end_effector_linear_velocity",
            "end_effector_angular_velocity",
            "base_linear_velocity",
        )
        squares[LAYOUT.slices["base_angular_velocity"], 4] = self.c**2
        return squares

    def observe(self, sensors: Array, time: Array) -> Array:
        """Observations (N, size) from the model's sensors (N, 47) and the time (N,) in s."""
        # Runs at every step, also for N = 1: what counts here is the number of numpy calls.
        observation = np.empty((len(sensors), LAYOUT.size))
        observation[:, :MEASURED] = sensors
        np.subtract(sensors[:, _GOAL], sensors[:, _TIP], out=observation[:, _POSITION_ERROR])
        # goal * conjugate(end-effector) as two stacked matrix products, which give the same bits for any N.
        left = (sensors[:, None, _GOAL_TURN] @ _QUOTIENT).reshape(-1, 4, 4)
        error = (left @ sensors[:, _TIP_TURN, None])[..., 0]
        cosine, vector = error[:, :1], error[:, 1:]
        sine = np.sqrt((vector * vector).sum(axis=1, keepdims=True))
        # Twice atan2 with |w|, and the vector's sign flipped where w < 0: the short way round.
        half = np.arctan2(sine, np.abs(cosine))
        factor = np.copysign(half / np.maximum(0.5 * sine, _TINY), cosine)
        np.multiply(factor, vector, out=observation[:, _ROTATION_ERROR])
        observation[:, -1] = time
        return observation

    def norms(self, observation: Array) -> Array:
        """(N, 5): position error m, orientation error rad, end-effector's |v| m/s and |w| rad/s, and the root
        of the integrand of eq. 20, sqrt(c^2 w.w + v.v) of the satellite, m/s."""
        return np.sqrt(((observation * observation)[:, None, :] @ self._squares)[:, 0])

    def attitude(self, observation: Array) -> Array:
        """Angle (N,) of the satellite from its initial attitude, rad."""
        quaternion = observation[:, LAYOUT.slices["base_quaternion"]]
        vector = quaternion[:, 1:]
        return 2.0 * np.arctan2(np.sqrt((vector * vector).sum(axis=1)), np.abs(quaternion[:, 0]))

    def in_envelope(self, norms: Array) -> NDArray[np.bool_]:
        """Whether the capture conditions hold now, (N,) bool, from `norms`."""
        return np.all(norms[:, :4] <= self.envelope.limits, axis=1)

    @cached_property
    def reward_names(self) -> tuple[str, ...]:
        """Names of the reward terms, in the order of `reward_terms`."""
        names = tuple(f.name for f in fields(RewardWeights))
        return names if self.reward == "dense" else ("attitude", "capture", "failure")

    @cached_property
    def _rates(self) -> Array:
        """What a unit of each quantity in `reward_terms` pays in a step."""
        weight, dt = self.weights, self.control_period
        paid = {
            "attitude": -dt * weight.attitude,
            "attitude_angle": -dt * weight.attitude_angle,
            "position": -dt * weight.position,
            "orientation": -dt * weight.orientation,
            "precision": dt * weight.precision,
            "effort": -dt * weight.effort,
            "capture": weight.capture,
            "failure": -weight.failure,
        }
        return np.array([paid[name] for name in self.reward_names])

    def reward_terms(
        self,
        norms: Array,
        attitude: Array,
        action: Array,
        captured: NDArray[np.bool_],
        failed: NDArray[np.bool_],
    ) -> Array:
        """Reward terms (N, k), named by `reward_names`; the reward is their sum.

        Args:
            norms: (N, 5). attitude: (N,) rad. action: (N, m) in [-1, 1].
            captured, failed: (N,) bool, true on the step where the episode ends so.
        """
        terms = np.empty((len(norms), len(self.reward_names)))
        terms[:, 0] = norms[:, 4] * norms[:, 4]
        if self.reward == "dense":
            terms[:, 1] = attitude
            terms[:, 2:4] = norms[:, :2]
            terms[:, 4] = np.exp(-(norms[:, :2] / self.envelope.limits[:2]).max(axis=1))
            terms[:, 5] = (action * action).sum(axis=1) / action.shape[1]
        terms[:, -2] = captured
        terms[:, -1] = failed
        terms *= self._rates
        return terms


def _quotient_tensor() -> Array:
    """T (4, 16) with (a @ T).reshape(4, 4) @ b the quaternion product of a and the conjugate of b."""
    unit = np.eye(4)
    conjugate = unit * np.array([1.0, -1.0, -1.0, -1.0])
    return np.stack([np.stack([multiply(a, b) for b in conjugate], axis=-1) for a in unit]).reshape(4, 16)


_QUOTIENT = _quotient_tensor()


@lru_cache(maxsize=4)
def _robot(variant: str) -> FloatingRobot:
    return FloatingRobot.from_model(single_arm_model(ModelOptions(variant)))


@lru_cache(maxsize=512)
def _goal_block(variant: str, difficulty: str, split: str, block: int) -> Goals:
    """Goals block * BLOCK ... of a split, from seeds alone.

    A goal is where the end-effector of the resting robot is after a minimum-jerk joint motion from home to a
    drawn configuration with the base floating freely, so that every goal can be reached.
    """
    robot = _robot(variant)
    draws = 16
    displacement = np.empty((BLOCK, draws, robot.n_joints))
    mass_scale = np.ones(BLOCK)
    for row in range(BLOCK):
        rng = np.random.default_rng([SPLIT_SEED[split], DIFFICULTIES.index(difficulty), block * BLOCK + row])
        displacement[row] = rng.uniform(-1.0, 1.0, (draws, robot.n_joints))
        if split == "ood":
            largest = np.abs(displacement[row]).max(axis=1, keepdims=True)
            displacement[row] *= rng.uniform(*OOD_RADIUS, (draws, 1)) / largest
            mass_scale[row] = rng.uniform(*OOD_MASS)
    q = robot.home + RADIUS[difficulty] * displacement
    tip = robot.end_effector_pose(q)[0]
    start = robot.end_effector_pose(robot.home)[0]
    # The test is on poses in the base frame: the base moves little, and the margin is ample.
    clear = np.abs(tip).max(axis=-1) > SINGLE_ARM.satellite_side / 2 + CLEARANCE
    usable = clear & (np.linalg.norm(tip - start, axis=-1) > NEAREST)
    if not usable.any(axis=1).all():
        raise GoalError("a goal could not be drawn: every candidate lies in the satellite or at the start")
    chosen = q[np.arange(BLOCK), usable.argmax(axis=1)]
    path, rate, dt = minimum_jerk(robot.home, chosen, 10.0, NODES)
    position, quaternion = roll_out_base(robot, path, rate, dt)
    local_position, local_rotation = robot.end_effector_pose(chosen)
    goal_quaternion = multiply(quaternion[:, -1], from_matrix(local_rotation))
    return Goals(
        position=position[:, -1] + rotate(quaternion[:, -1], local_position),
        quaternion=np.where(goal_quaternion[:, :1] < 0, -goal_quaternion, goal_quaternion),
        mass_scale=mass_scale,
    )
