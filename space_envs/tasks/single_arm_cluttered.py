"""SpaceCapture/SingleArmCluttered: the static grapple pose of the single arm, beyond keep-out spheres.

Three spheres are at rest in the inertial frame. Links are capsules: a contact with a sphere or with the
satellite ends the episode as a failure. Contacts of the satellite itself with spheres are not checked: they
are at least 0.3 m from it at the start, and it moves that far for some hard goals only. A goal is drawn as in
SpaceCapture/SingleArm, as the final pose of a minimum-jerk joint motion. It is accepted if that motion
collides with a sphere and a detour in joint space, within the limits of rate and acceleration, reaches the
goal clear of all spheres.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property, lru_cache
from importlib.resources import files

import mujoco
import numpy as np
from numpy.typing import NDArray

from space_envs.dynamics.rotations import Array
from space_envs.errors import GoalError
from space_envs.robots.contact_checks import ContactChecks
from space_envs.robots.models import OBSTACLE, SceneOptions, robot_model
from space_envs.robots.robot import Robot
from space_envs.scenery.single_arm import resize_keep_out
from space_envs.simulation import Simulation
from space_envs.tasks.base import BLOCK
from space_envs.tasks.common import Field, GoalOption, ObservationLayout
from space_envs.tasks.goals.clutter import COUNT, ClutteredGoals, bus_gaps, draw_scenes
from space_envs.tasks.goals.detours import find_draws
from space_envs.tasks.goals.stored import stored_draws
from space_envs.tasks.robots import length_factor
from space_envs.tasks.single_arm import SingleArmTask

CLUTTERED_SPLIT_SIZE = {"train": 1024, "validation": 128, "test": 512, "ood": 256}
_FILE = "single_arm_cluttered_draws.npz"


@dataclass(frozen=True)
class SingleArmClutteredTask(SingleArmTask):
    """The same arm reaches a static grapple pose around spheres that block the direct path."""

    frozen_robot = "shyam2020"
    split_sizes = CLUTTERED_SPLIT_SIZE

    @cached_property
    def layout(self) -> ObservationLayout:
        """Layout of the observation vector."""
        farthest = 10.0 * length_factor(self.robot)
        centres = "centres of the keep-out spheres, inertial frame, m"
        return ObservationLayout(
            (
                *super().layout.fields,
                Field("obstacle_position", 3 * COUNT, farthest, centres),
                Field("obstacle_radius", COUNT, 1.0, "of the keep-out spheres, m"),
            )
        )

    @property
    def goal_options(self) -> dict[str, GoalOption]:
        """Options of `reset` that together define a goal."""
        return {
            **super().goal_options,
            "obstacle_position": GoalOption(
                3 * COUNT, largest=10.0 * length_factor(self.robot), parts=f"{COUNT} spheres x 3"
            ),
            "obstacle_radius": GoalOption(COUNT, parts=f"{COUNT} spheres x 1"),
        }

    @property
    def model(self) -> mujoco.MjModel:
        """The compiled model, shared and read-only."""
        return robot_model(self.robot, SceneOptions(self.step_size, obstacles=COUNT))

    @property
    def render_model(self) -> mujoco.MjModel:
        """The model with geometry for rendering."""
        return robot_model(self.robot, SceneOptions(self.step_size, visual=True, obstacles=COUNT))

    def goal_block(self, split: str, block: int) -> ClutteredGoals:
        """Goals of a block."""
        return _goal_block(self.robot, self.frozen, self.difficulty, split, block)

    def given_goals(self, values: Mapping[str, Array], joint_position: Array | None) -> ClutteredGoals:
        """Goals from the values of the options; errors as in `check_goals` and `check_spheres`."""
        pose = super().given_goals(values, joint_position)
        centre = values["obstacle_position"].reshape(-1, COUNT, 3)
        goals = ClutteredGoals(
            **vars(pose), obstacle_position=centre, obstacle_radius=values["obstacle_radius"]
        )
        self.check_spheres(goals)
        return goals

    def check_spheres(self, goals: ClutteredGoals) -> None:
        """Reject a user's spheres with contacts at the start or at the goal.

        Raises:
            GoalError: for an invalid radius, a sphere that touches the satellite or the arm at the start, or
                one that contains the grapple.
        """
        radius, centre = goals.obstacle_radius, goals.obstacle_position
        if not ((radius > 0.0) & (radius <= 1.0)).all():
            raise GoalError(f"obstacle_radius must lie in (0, 1] m, got {radius.tolist()}")
        points = self.contacts.points(self.mechanics, goals.joint_position)  # the satellite is at the origin
        arm = self.contacts.sphere_gaps(points, goals.spheres).min(axis=-2)
        grapple = np.linalg.norm(goals.position[:, None] - centre, axis=-1) - radius
        for gap, problem in (
            (bus_gaps(self.contacts, centre, radius), "touches the satellite at the start"),
            (arm, "touches the arm at the start"),
            (grapple, "holds the goal"),
        ):
            if (gap <= 0.0).any():
                row, sphere = np.argwhere(gap <= 0.0)[0]
                raise GoalError(f"obstacle {sphere + 1} {problem}: the gap is {gap[row, sphere]:.3f} m")

    def place(self, simulation: Simulation, rows: NDArray[np.int64], goals: ClutteredGoals) -> None:
        """Set the poses of the grapple and the spheres to the goals."""
        super().place(simulation, rows, goals)
        simulation.mocap_pos[rows, 1 : 1 + COUNT] = goals.obstacle_position
        surface = np.zeros((len(rows), COUNT, 3))
        surface[..., 0] = goals.obstacle_radius
        simulation.place_sites(rows, _SURFACES, surface)

    def update_visuals(
        self, model: mujoco.MjModel, data: mujoco.MjData | None, goals: ClutteredGoals, row: int
    ) -> None:
        """Set the sizes of the rendered spheres, and the poses of spheres and grapple."""
        super().update_visuals(model, data, goals, row)
        resize_keep_out(model, goals.obstacle_radius[row].tolist())
        if data is not None:
            data.mocap_pos[1 : 1 + COUNT] = goals.obstacle_position[row]

    def observe(self, sensors: Array, time: Array, peak_attitude: Array) -> Array:
        """Observations (N, size); see the base class."""
        observation = super().observe(sensors, time, peak_attitude)
        observation[:, self._obstacles] = sensors.take(self._obstacle_columns, axis=1)
        return observation

    @cached_property
    def _obstacles(self) -> slice:
        """Components of the observation that describe the spheres."""
        first, last = (self.layout.slices[name] for name in ("obstacle_position", "obstacle_radius"))
        return slice(first.start, last.stop)

    @cached_property
    def _obstacle_columns(self) -> NDArray[np.int64]:
        """Sensors of the centres of the spheres, then of their radii: the x components of their surfaces."""
        names = [f"{OBSTACLE}{number}" for number in range(1, COUNT + 1)]
        first = {
            name: int(self.model.sensor(name).adr[0])
            for n in names
            for name in (f"{n}_position", f"{n}_radius")
        }
        centres = [first[f"{name}_position"] + axis for name in names for axis in range(3)]
        return np.array([*centres, *(first[f"{name}_radius"] for name in names)])

    @cached_property
    def contact_names(self) -> tuple[str, ...]:
        """Names of the contacts, by the codes of `collided`."""
        return (*self.contacts.names, *dict.fromkeys(self._sphere_pairs))

    @cached_property
    def _sphere_pairs(self) -> list[str]:
        links = self.contacts.link_names(self.contacts.near_others)
        return [f"{link} and obstacle {sphere + 1}" for link in links for sphere in range(COUNT)]

    @cached_property
    def _sphere_checks(self) -> ContactChecks:
        contacts, near = self.contacts, self.contacts.near_others
        spheres = near.radius, COUNT, self._obstacle_columns
        functions = [("sphere_contacts", (0, *contacts.placed(near, "world"), *spheres))]
        codes = np.array([self.contact_names.index(pair) for pair in self._sphere_pairs])
        return ContactChecks(functions, self._sensed_gaps, np.r_[contacts.columns["world"]], codes)

    def _sensed_gaps(self, sensors: Array) -> Array:
        """Gaps (N, S * COUNT) of capsules and spheres, m, in the order of the pairs, from sensors (N, s)."""
        n, seen = len(sensors), sensors.take(self._obstacle_columns, axis=1)
        centres, radii = seen[:, : 3 * COUNT].reshape(n, COUNT, 3), seen[:, 3 * COUNT :, None]
        points = self.contacts.sensed_points(sensors, "world")
        return self.contacts.sphere_gaps(points, np.concatenate([centres, radii], axis=-1)).reshape(n, -1)

    def collided(self, before: Array, sensors: Array) -> NDArray[np.int64]:
        """Codes (N,) of the first contact of a link with the satellite or a sphere in a control period.

        Within the period the ends of the links are assumed to move straight: the error is about a millimetre
        at the limits of rate and acceleration.
        """
        code = super().collided(before, sensors)
        sphere = self._sphere_checks.first(before, sensors)
        return np.where(code > 0, code, sphere)


_SURFACES = tuple(f"obstacle{number}_surface" for number in range(1, COUNT + 1))


@lru_cache(maxsize=1)
def _frozen() -> dict[str, NDArray[np.int64]]:
    with np.load(str(files("space_envs") / "tasks" / _FILE), allow_pickle=False) as archive:
        return {name: archive[name].astype(np.int64) for name in archive.files}


def frozen_draws(variant: str, difficulty: str, split: str) -> NDArray[np.int64]:
    """(size, 5) of a split of the id's own robot: stored numbers of the scene, the detour and the spheres."""
    return _frozen()[f"{variant}_{difficulty}_{split}"]


@lru_cache(maxsize=512)
def _goal_block(robot: Robot, frozen: bool, difficulty: str, split: str, block: int) -> ClutteredGoals:
    """Goals of a block of a split, from seeds and the stored numbers of draws."""
    rows = np.arange(block * BLOCK, (block + 1) * BLOCK)
    if frozen:
        draws = frozen_draws(robot.variant, difficulty, split)[rows]
    else:
        name = f"cluttered-v{SingleArmClutteredTask.version}-{difficulty}-{split}-{block}"
        draws = stored_draws(robot, name, lambda: find_draws(robot, difficulty, split, block))
    return draw_scenes(robot, difficulty, split, rows, draws[:, 0]).goals(draws[:, 2:])
