"""Base of every capture task: configuration, splits, capture, reward."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from typing import Any, ClassVar, cast

import mujoco
import numpy as np
from numpy.typing import NDArray

from space_envs.checks import flag
from space_envs.dynamics import FloatingRobot
from space_envs.dynamics.rotations import Array, base_rotation
from space_envs.errors import ConfigurationError, positive, positive_integer, shown, unknown_name
from space_envs.metric import Metric
from space_envs.perturbations.amounts import NOMINAL, Perturbation
from space_envs.robots.models import SceneOptions, robot_mechanics, robot_model
from space_envs.robots.robot import Robot
from space_envs.robots.zoo import find_robot
from space_envs.simulation import Simulation
from space_envs.step_limits.measured import measured_steps
from space_envs.tasks.common import (
    DIFFICULTIES,
    EPISODE_FIELDS,
    REWARDS,
    CaptureEnvelope,
    CaptureErrors,
    CaptureLimits,
    GoalOption,
    Goals,
    ObservationLayout,
)
from space_envs.tasks.contacts import Contacts
from space_envs.tasks.goals.kinds import GoalKind
from space_envs.tasks.rewards import DENSE, SPARSE, RewardTerm, StepQuantities
from space_envs.tasks.robots import LEAST_TIMESTEP, check_robot, usual_period

# Largest values of keywords: deg (larger angles would exceed the bound of the observation), and m/rad.
LARGEST = {"attitude_limit": 3600.0, "c": 1e6}
MOST_STEPS = 10**6  # of an episode
BLOCK = 64  # goals are computed in whole blocks, so that a goal is bitwise the same in any batch


@dataclass(frozen=True)
class CaptureTask:
    """A task's configuration and its pure functions on batched state; subclasses define robot and goals.

    Attributes:
        difficulty: easy, medium or hard; size of the goal region.
        split: default set of goals that `reset` draws from.
        reward: dense or sparse.
        control_period: between two actions, s; by default 0.1 s or, where the robot's drives need it, less.
        timestep: of the simulation, s; None is the robot's default, for which docs/momentum.md shows that
            momentum drift is well below the bound.
        horizon: control periods after which an episode is truncated.
        envelope: of a capture. attitude_limit: deg from the initial attitude, beyond which an
            episode fails.
        c: angular to linear conversion of eq. 20, m/rad.
        collisions: whether a contact of a link ends the episode; otherwise links pass through bodies.
        robot: its name, the path of its description (TOML) or a `Robot`, which it is afterwards; by default
            the id's own. variant: of the robot; by default its first.
        perturbation: of the simulated robot and of what is observed, a `Perturbation` or its text, such as
            mild, severe or "mass=0.1 action_delay=1"; policies know the nominal model (docs/robustness.md).
    """

    difficulty: str = "medium"
    split: str = "train"
    reward: str = "dense"
    control_period: float = cast("float", None)
    timestep: float | None = None
    horizon: int = 200
    envelope: CaptureEnvelope = field(default_factory=CaptureEnvelope)
    attitude_limit: float = 45.0
    c: float = 1.0
    collisions: bool = True
    robot: Robot = cast("Robot", None)
    variant: str = cast("str", None)
    perturbation: Perturbation = cast("Perturbation", NOMINAL)

    # Defined by subclasses.
    version: ClassVar[int] = 3  # of the task in records, raised with every change that affects a metric
    own_robot: ClassVar[str]  # name of the robot that is used by default
    frozen_robot: ClassVar[str | None] = None  # of the one whose draws of goals are stored with the package
    arms: ClassVar[int]  # how many the robot must have
    planar: ClassVar[bool] = False  # whether the robot must move in the plane
    difficulties: ClassVar[tuple[str, ...]] = DIFFICULTIES  # sizes of the goal region
    split_sizes: ClassVar[Mapping[str, int]]
    goal: ClassVar[GoalKind] = "pose"  # what of a grapple is asked; a keyword where there is a choice
    collides: ClassVar[bool] = False  # whether the task checks contacts
    dense_reward: ClassVar[tuple[RewardTerm, ...]] = DENSE  # terms of reward `dense`
    sparse_reward: ClassVar[tuple[RewardTerm, ...]] = SPARSE  # terms of reward `sparse`
    metrics: ClassVar[tuple[Metric, ...]] = ()  # of this task alone, in addition to the common ones

    def __post_init__(self) -> None:
        self._set_robot()
        for kind, value, valid in (
            ("difficulty", self.difficulty, self.difficulties),
            ("split", self.split, self.split_sizes),
            ("reward", self.reward, REWARDS),
        ):
            if not isinstance(value, str) or value not in valid:
                raise unknown_name(kind, value, valid)
        steps = self.robot.steps
        if self.control_period is None:
            object.__setattr__(self, "control_period", usual_period(steps))
        for name in ("control_period", "attitude_limit", "c"):
            object.__setattr__(self, name, positive(name, getattr(self, name), LARGEST.get(name)))
        if self.timestep is not None:
            object.__setattr__(self, "timestep", positive("timestep", self.timestep))
            if not LEAST_TIMESTEP <= self.timestep <= steps.largest_timestep:
                raise ConfigurationError(
                    f"timestep must lie in {LEAST_TIMESTEP:g} to {steps.largest_timestep:g} s, the largest "
                    f"that conserves momentum to the published bound; got {self.timestep!r}"
                )
        if self.control_period > steps.largest_control_period:
            raise ConfigurationError(
                f"control_period must be at most {steps.largest_control_period:g} s, the largest at which "
                f"the drives are stable; got {self.control_period!r}"
            )
        object.__setattr__(self, "horizon", positive_integer("horizon", self.horizon, MOST_STEPS))
        flag("collisions", self.collisions)
        object.__setattr__(self, "perturbation", Perturbation.of(self.perturbation))
        names = [term.name for term in self.reward_terms]
        if len(set(names)) < len(names):
            raise ConfigurationError(f"names of reward terms must differ, got {names}")
        substeps = self.control_period / self.step_size
        if not substeps > 0.5 or abs(substeps - round(substeps)) > 1e-9 * substeps:
            raise ConfigurationError(
                f"control_period must be a multiple of timestep, got {self.control_period!r} and "
                f"{self.step_size!r} s"
            )
        bounds = {field.name: field.bound for field in self.layout.fields}
        if missing := [field.name for field in EPISODE_FIELDS if field.name not in bounds]:
            raise ConfigurationError(f"the layout of a task's observation lacks {' and '.join(missing)}")
        longest = bounds["time"]
        if self.horizon * self.control_period > longest:
            raise ConfigurationError(
                f"an episode lasts {longest:g} s at most, got horizon {self.horizon} of "
                f"{self.control_period:g} s"
            )

    def _set_robot(self) -> None:
        """Find the robot.

        Raises:
            ConfigurationError: if there is no such robot, or it is not one for this task.
        """
        source = self.own_robot if self.robot is None else self.robot
        robot = find_robot(source, self.variant, measured_steps)
        check_robot(robot, self.arms, self.planar, type(self).__name__)
        object.__setattr__(self, "robot", robot)
        object.__setattr__(self, "variant", robot.variant)

    # Implemented by subclasses -----------------------------------------------------------------------------

    @property
    def layout(self) -> ObservationLayout:
        """Layout of the observation vector: a slice for each named quantity."""
        raise NotImplementedError

    @property
    def goal_options(self) -> Mapping[str, GoalOption]:
        """Options of `reset` that together define a goal."""
        raise NotImplementedError

    def goal_block(self, split: str, block: int) -> Goals:
        """Goals block * BLOCK to (block + 1) * BLOCK - 1 of a split, drawn from seeds."""
        raise NotImplementedError

    def given_goals(self, values: Mapping[str, Array], joint_position: Array | None) -> Goals:
        """Goals (K) from the values of a user's reset options, validated.

        Args:
            values: (K, width) by the names in `goal_options`.
            joint_position: (K, n) rad at the start; None is home.

        Raises:
            GoalError: for a goal that is malformed or out of reach.
        """
        raise NotImplementedError

    def place(self, simulation: Simulation, rows: NDArray[np.int64], goals: Goals) -> None:
        """Put the goals (k) into rows (k,) of a simulation that was reset."""
        raise NotImplementedError

    def update_visuals(
        self, model: mujoco.MjModel, data: mujoco.MjData | None, goals: Goals, row: int
    ) -> None:
        """Update model and data for rendering to the goal of a row, except for qpos."""
        raise NotImplementedError

    def observe(self, sensors: Array, time: Array, peak_attitude: Array) -> Array:
        """Observations (N, size) from the model's sensors (N, s).

        Args:
            time: (N,) since the start of the episode, s. peak_attitude: (N,) largest angle of the satellite
                from its initial attitude so far, rad.
        """
        raise NotImplementedError

    def errors(self, observation: Array) -> CaptureErrors:
        """Capture errors (N,) from observations (N, size)."""
        raise NotImplementedError

    def check_start(self, goals: Goals) -> None:
        """Reject a user's goals or joint angles for which an episode would start in collision.

        Raises:
            GoalError: with the two bodies in contact and the gap.
        """

    # Derived, unless overridden ----------------------------------------------------------------------------

    @property
    def model(self) -> mujoco.MjModel:
        """The compiled model, shared and read-only."""
        return robot_model(self.robot, SceneOptions(self.step_size))

    @property
    def render_model(self) -> mujoco.MjModel:
        """The model with geometry for rendering."""
        return robot_model(self.robot, SceneOptions(self.step_size, visual=True))

    @property
    def mechanics(self) -> FloatingRobot:
        """The robot's momentum-level mathematics, read from the model."""
        return robot_mechanics(self.robot)

    @cached_property
    def frozen(self) -> bool:
        """Whether the draws of goals of the robot are stored with the package."""
        if self.frozen_robot is None:
            return False
        try:
            own = find_robot(self.frozen_robot, self.variant)
        except ConfigurationError:  # that robot has no such variant
            return False
        return replace(self.robot, steps=own.steps).digest == own.digest

    @cached_property
    def contacts(self) -> Contacts:
        """Contact checks of the robot's capsules."""
        return Contacts.of(self.model, self.robot)

    @property
    def contact_names(self) -> tuple[str, ...]:
        """Names of the contacts, by the codes of `collided`; the first is empty."""
        return self.contacts.names

    def attitude(self, observation: Array) -> Array:
        """Angle (N,) of the satellite from its initial attitude, rad."""
        return base_rotation(observation[:, self._base_attitude])

    @cached_property
    def _base_attitude(self) -> slice:
        return self.layout.slices["base_angle" if self.planar else "base_quaternion"]

    def collided(self, before: Array, sensors: Array) -> NDArray[np.int64]:
        """Codes (N,) of the first contact in a control period; 0 is none.

        Args:
            before, sensors: (N, s) sensors of the model at the beginning and at the end of the period.
        """
        return self.contacts.touched(before, sensors)

    @property
    def reward_terms(self) -> tuple[RewardTerm, ...]:
        """Reward terms of the keyword `reward`."""
        return self.dense_reward if self.reward == "dense" else self.sparse_reward

    @property
    def step_size(self) -> float:
        """Step of the simulation, s."""
        return self.robot.steps.default_timestep if self.timestep is None else self.timestep

    @property
    def substeps(self) -> int:
        """Simulation steps per control step."""
        return round(self.control_period / self.step_size)

    @cached_property
    def hold_steps(self) -> int:
        """Consecutive control periods inside the envelope, at both ends, that complete a capture."""
        return math.ceil(self.envelope.hold / self.control_period - 1e-9)

    @cached_property
    def attitude_limit_rad(self) -> float:
        """The attitude limit in rad."""
        return float(np.deg2rad(self.attitude_limit))

    def split_size(self, split: str) -> int:
        """Number of goals in a split.

        Raises:
            ConfigurationError: for an unknown split.
        """
        if not isinstance(split, str) or split not in self.split_sizes:
            raise unknown_name("split", split, self.split_sizes)
        return self.split_sizes[split]

    def goals(self, split: str, indices: NDArray[np.int64]) -> Any:
        """Goals (K) of a split by index; the same on every machine to rounding.

        Raises:
            ConfigurationError: for an unknown split or an index outside it.
        """
        size = self.split_size(split)
        indices = np.asarray(indices)
        whole = indices.dtype.kind in "iu"
        outside = (indices < 0) | (indices >= size) if whole else np.ones(indices.shape, dtype=bool)
        if outside.any():
            raise ConfigurationError(
                f"index of split {split!r} must be an integer in 0..{size - 1}, got "
                f"{shown(indices[outside].tolist()[0])}"
            )
        blocks = [self.goal_block(split, int(block)) for block in indices // BLOCK]
        rows = indices % BLOCK
        kind = type(self.goal_block(split, 0)) if not blocks else type(blocks[0])
        return kind(
            **{
                f.name: np.array([getattr(b, f.name)[r] for b, r in zip(blocks, rows, strict=True)])
                for f in fields(kind)
            }
        )

    @cached_property
    def limits(self) -> CaptureLimits:
        """Largest errors of a capture."""
        return self.envelope.limits

    @cached_property
    def _rates(self) -> Array:
        return np.array([term.rate(self.control_period) for term in self.reward_terms])

    @cached_property
    def _changes(self) -> list[int]:
        """Columns of the reward terms that are changes of a potential."""
        return [column for column, term in enumerate(self.reward_terms) if term.per == "change"]

    def weighted_terms(self, step: StepQuantities) -> Array:
        """Weighted reward terms (N, k) of a control period, in the order of `reward_terms`; the reward is
        their sum."""
        values = np.empty((len(step.attitude), len(self._rates)))
        for column, term in enumerate(self.reward_terms):
            values[:, column] = term.function(step)
        if step.captured.any():
            values[np.ix_(step.captured, np.array(self._changes, dtype=np.int64))] = 0.0
        if step.beginning is not None:
            for column in self._changes:
                values[:, column] -= self.reward_terms[column].function(step.beginning)
        values *= self._rates
        return values
