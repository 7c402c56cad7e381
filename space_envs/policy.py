"""Interface of policies: signature, context, requirements on tasks, and loading of a user's class."""

import importlib
from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum
from typing import TYPE_CHECKING, Any, Literal, Protocol, Self, cast

import mujoco
import numpy as np
from numpy.typing import NDArray

from space_envs.drives import STOP_MARGIN
from space_envs.dynamics import FloatingRobot
from space_envs.dynamics.rotations import Array
from space_envs.errors import PolicyError, unknown_name
from space_envs.foreign_code import described
from space_envs.robots.robot import Robot
from space_envs.tasks.common import CaptureEnvelope, ObservationLayout
from space_envs.tasks.contacts import Contacts
from space_envs.tasks.goals.kinds import GoalKind

if TYPE_CHECKING:
    from space_envs.envs import CaptureEnv, CaptureVectorEnv

DEFAULT_CONTROL_MODE = "joint_velocity"


class Knowledge(StrEnum):
    """Knowledge about the task that a policy is made of; results of different kinds are no even match."""

    NONE = "none"  # acts without any: a baseline
    MODEL = "model"  # plans or controls by the equations of the public model
    LEARNED_WITH_MODEL = "learned with model"  # a network, trained by derivatives of the public model
    IMITATION = "imitation"  # a network, trained on the actions of an expert that knows the model
    INTERACTION = "interaction"  # a network, trained by the rewards of episodes alone
    UNSTATED = "unstated"  # the policy does not tell


class Policy(Protocol):
    """Chooses actions; the signature of `predict` is stable-baselines3's.

    A policy class is built as `Class(context, seed)` with a `PolicyContext` and an int. Three class
    attributes are optional: `control_mode`, its default control mode (joint_velocity if absent), `needs`, a
    `Needs` with its requirements on tasks (default: none), and `knowledge`, a `Knowledge` (default:
    unstated).
    """

    def predict(
        self,
        observation: Array,
        state: Any = None,
        episode_start: NDArray[np.bool_] | None = None,
        deterministic: bool = True,
    ) -> tuple[Array, Any]:
        """Actions (N, m) in [-1, 1] for observations (N, size), and the state for the next call.

        Args:
            observation: (N, size), with the context's layout.
            state: returned by the previous call; None at the first call.
            episode_start: (N,) rows whose episode begins with this observation; a planner plans these.
                None means all rows if there is no state yet, otherwise none.
            deterministic: whether a stochastic policy returns its mean action.

        A state that is a `space_envs.evaluation.play.causes.PlanState` marks the episodes without a plan: the
        records of failed episodes then have the cause and the reason. Other states are not inspected.
        """
        ...


@dataclass(frozen=True, eq=False)
class PolicyContext:
    """Information for a policy besides observations: the nominal model and the parameters of the task.

    Attributes:
        env_id: registered id. control_mode: meaning of an action.
        robot: its links, limits and shape. model: its compiled MuJoCo model with nominal masses, read-only.
            arm: its momentum-level mathematics.
        layout: slices of the named quantities of an observation.
        control_period: s. horizon: steps after which an episode is truncated.
        action_scale: (m,) physical units per unit action (rad/s, N m, or m/s and rad/s).
        joint_limits: (n, 2) rad, least and largest angle that the drives allow.
        rate_limit, acceleration_limit: (n,) rad/s and rad/s^2.
        envelope: of a capture. c: m/rad of the attitude cost (eq. 20 of shyam2020).
        jobs: number of processes for planning; -1 is one per core.
        contacts: gaps between the links and other bodies; None if contacts are not checked.
        goal_kind: what a capture asks of an end-effector, the task's keyword `goal`.
    """

    env_id: str
    control_mode: str
    robot: Robot
    model: mujoco.MjModel
    arm: FloatingRobot
    layout: ObservationLayout
    control_period: float
    horizon: int
    action_scale: Array
    joint_limits: Array
    rate_limit: Array
    acceleration_limit: Array
    envelope: CaptureEnvelope
    c: float
    jobs: int = 1
    contacts: Contacts | None = None
    goal_kind: GoalKind = "pose"

    @classmethod
    def from_env(cls, env: "CaptureVectorEnv | CaptureEnv", jobs: int = 1) -> Self:
        """The context of an environment (unwrapped)."""
        vector = cast("CaptureVectorEnv", getattr(env, "vector", env))
        task = vector.task
        return cls(
            env_id=vector.env_id,
            control_mode=vector.control_mode,
            robot=task.robot,
            model=task.model,
            arm=task.mechanics,
            layout=task.layout,
            control_period=task.control_period,
            horizon=task.horizon,
            action_scale=vector.mode.scale,
            joint_limits=task.robot.joint_range + STOP_MARGIN * np.array([1.0, -1.0]),
            rate_limit=vector.drive.rate_limit,
            acceleration_limit=vector.drive.acceleration_limit,
            envelope=task.envelope,
            c=task.c,
            jobs=jobs,
            contacts=task.contacts if task.collides and task.collisions else None,
            goal_kind=task.goal,
        )

    @property
    def arms(self) -> int:
        """Number of arms."""
        return len(self.robot.arms)

    @property
    def joints(self) -> int:
        """Number of joints of all arms."""
        return self.robot.n_joints

    @property
    def planar(self) -> bool:
        """Whether the satellite moves in the plane z = 0."""
        return self.robot.planar

    @property
    def goals(self) -> Literal["static", "moving"]:
        """Kind of goals, moving or static: the velocity of moving ones is observed."""
        return "moving" if "goal_linear_velocity" in self.layout.slices else "static"

    @property
    def obstacles(self) -> bool:
        """Whether obstacles are observed."""
        return "obstacle_position" in self.layout.slices

    def check_observation(self, observation: NDArray) -> Array:
        """Observations as float64 (N, size).

        Raises:
            PolicyError: for another shape, NaN or infinity.
        """
        observation = np.asarray(observation, dtype=np.float64)
        if observation.ndim != 2 or observation.shape[1] != self.layout.size:
            raise PolicyError(
                f"observations must have shape (N, {self.layout.size}), got {observation.shape}"
            )
        if not np.isfinite(observation).all():
            raise PolicyError("observations must be finite, got NaN or infinity")
        return observation


@dataclass(frozen=True)
class Needs:
    """Requirements of a policy on tasks; the defaults fit every task.

    Attributes:
        fields: required fields of the observation. control_modes: supported ones; empty is any.
        arms: how many; None is any number. joints: the least number of joints of each arm; None is any.
        planar: a robot in the plane (True) or in space (False); None is either.
        goals: static or moving; None is either.
        obstacles: required (True) or not supported (False); None is either.
        other: function of a context that returns the reason why the policy does not fit, or None; for any
            other requirement.
    """

    fields: tuple[str, ...] = ()
    control_modes: tuple[str, ...] = ()
    arms: int | None = None
    joints: int | None = None
    planar: bool | None = None
    goals: Literal["static", "moving"] | None = None
    obstacles: bool | None = None
    other: Callable[[PolicyContext], str | None] | None = None

    def missing(self, context: PolicyContext) -> list[str]:
        """Reasons why a policy does not fit a context's task and control mode; empty if it fits."""
        reasons = [
            f"it needs {words(needed)}, the task has {words(got)}"
            for name, words in _NEEDS.items()
            if (needed := getattr(self, name)) is not None and needed != (got := getattr(context, name))
        ]
        each = context.joints // context.arms
        if self.joints is not None and each < self.joints:
            reasons.append(
                f"it needs arms of at least {self.joints} joints, those of {context.robot.name!r} have {each}"
            )
        absent = [name for name in self.fields if name not in context.layout.slices]
        if absent:
            reasons.append(f"it needs {' and '.join(absent)} in the observation, which the task lacks")
        if self.control_modes and context.control_mode not in self.control_modes:
            modes = " or ".join(map(repr, self.control_modes))
            reasons.append(f"it acts in control mode {modes}, the environment is in {context.control_mode!r}")
        reason = None if self.other is None else self.other(context)
        return reasons if reason is None else [*reasons, reason]


# Attribute of `Needs`, and of `PolicyContext`, and its values in words.
_NEEDS: dict[str, Callable[[Any], str]] = {
    "arms": lambda count: f"{count} arm{'s' * (count != 1)}",
    "planar": lambda planar: "a robot in the plane" if planar else "a robot in space",
    "goals": lambda kind: f"{kind} goals",
    "obstacles": lambda some: "obstacles" if some else "no obstacles",
}


def load_policy_class(path: str) -> type[Policy]:
    """Import the policy class named as `package.module:Class`. This runs that module's code.

    Raises:
        PolicyError: if the name has another form, nothing of that name can be imported, or it is no class
            with a `predict`.
    """
    module_name, _, class_name = path.partition(":")
    if not all(part.isidentifier() for part in [*module_name.split("."), class_name]):
        raise PolicyError(f"a policy class is named as 'package.module:Class', got {path!r}")
    try:
        module = importlib.import_module(module_name)
        found = getattr(module, class_name, None)
        names = [name for name, value in vars(module).items() if isinstance(value, type)]
        acts = isinstance(found, type) and callable(getattr(found, "predict", None))
    except KeyboardInterrupt:
        raise
    except BaseException as error:  # a user's module may raise anything on import
        raise PolicyError(
            f"module {module_name!r} of policy {path!r} cannot be imported: {described(error)}"
        ) from None
    if found is None:
        raise PolicyError(str(unknown_name(f"class of module {module_name!r}", class_name, names)))
    if not acts:
        raise PolicyError(f"{path!r} is not a class with a method `predict`")
    return cast("type[Policy]", found)
