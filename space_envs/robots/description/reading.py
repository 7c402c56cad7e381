"""`read_robot`: a robot from its description file, which docs/own_robot.md explains key by key."""

import os
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from space_envs.errors import shown, unknown_name
from space_envs.robots.description.mounting import assembled
from space_envs.robots.description.planes import check_plane
from space_envs.robots.description.satellites import SATELLITE_KEYS
from space_envs.robots.description.tables import DescriptionTable, merged, read_toml
from space_envs.robots.description.targets import TARGET_KEYS, read_target
from space_envs.robots.models.accelerations import with_accelerations
from space_envs.robots.robot import NOMINAL, Robot, StepLimits, View

KEYS = (
    "name",
    "variant",
    "planar",
    "satellite",
    "arm",
    "simulation",
    "target",
    "packages",
    "view",
    "variants",
)
ARM_KEYS = (
    *("file", "root", "tool", "tool_offset", "prefix", "mount", "lock", "home", "limits"),
    *("rotor_inertia", "links", "rods", "radius", "points", "capsules"),
)
SIMULATION_KEYS = ("timestep", "largest_timestep", "largest_control_period")
VIEW_KEYS = ("overview", "chase", "earth", "sun")
LONGEST_NAME = 100  # characters; names become parts of file names
PROVISIONAL = StepLimits(0.002, 0.002, 0.1)  # of a robot whose time steps are yet to be measured


def read_robot(
    file: str | Path, variant: str | None = None, measure: Callable[[Robot], StepLimits] | None = None
) -> Robot:
    """The robot that a TOML file describes.

    Args:
        file: the description. variant: name of one of its variants; None is the first.
        measure: time steps of a robot whose description gives none.

    Raises:
        ConfigurationError: for anything that is missing or not valid, with the place in the file.
    """
    path = Path(os.path.abspath(file))
    content = read_toml(path)
    table = DescriptionTable(content, path, "", KEYS)
    content = _of_variant(table, content, variant)
    chosen = content["variant"]
    table = DescriptionTable(content, path, "", KEYS)
    arms = table.tables("arm", ARM_KEYS)
    if len(arms) not in (1, 2):
        raise table.error(f"a robot has one or two [[arm]] tables, got {len(arms)}")
    satellite, built, notes = assembled(table, table.table("satellite", SATELLITE_KEYS), arms)
    planar = table.flag("planar", False)
    if planar:
        check_plane(arms, built)
    robot = Robot(
        name=_name(table, path),
        variant=chosen,
        satellite=satellite,
        arms=built,
        steps=PROVISIONAL,
        planar=planar,
        view=_view(table),
        notes=notes,
    )
    robot = with_accelerations(robot)
    if len(arms) == 2:
        robot = replace(robot, target=read_target(table.table("target", TARGET_KEYS, {}), robot))
    elif "target" in table:
        raise table.error("[target] describes what two arms capture, and this robot has one arm")
    return replace(robot, steps=_steps(table, robot, measure))


def _name(table: DescriptionTable, path: Path) -> str:
    """Name of the robot; that of its file if it has none."""
    name = table.text("name", path.stem)
    if not name.isprintable() or len(name) > LONGEST_NAME:
        raise table.error(f"name must be at most {LONGEST_NAME} printable characters, got {shown(name)}")
    return name


def _of_variant(table: DescriptionTable, content: Mapping[str, Any], variant: str | None) -> dict[str, Any]:
    """Content of a file with the changes of a variant, whose name is then its `variant`."""
    first = table.text("variant", NOMINAL)
    variants = table.get("variants", {})
    if not isinstance(variants, Mapping):
        raise table.error("[variants] must be a table of tables")
    names = (first, *variants)
    chosen = first if variant is None else variant
    if not isinstance(chosen, str) or chosen not in names:
        raise table.error(str(unknown_name("model variant", chosen, names)))
    own = {key: value for key, value in content.items() if key != "variants"}
    if chosen != first:
        changes = variants[chosen]
        DescriptionTable(
            changes, table.file, f"variants.{chosen}", [key for key in KEYS if key != "variants"]
        )
        own = merged(own, changes)
    return {**own, "variant": chosen}


def _steps(
    table: DescriptionTable, robot: Robot, measure: Callable[[Robot], StepLimits] | None
) -> StepLimits:
    """Time steps from `[simulation]`; those that it lacks are measured."""
    simulation = table.table("simulation", SIMULATION_KEYS, {})
    measured = PROVISIONAL
    if measure is not None and not all(key in simulation for key in ("timestep", "largest_control_period")):
        measured = measure(robot)
    step = simulation.positive("timestep", measured.default_timestep)
    largest = simulation.positive(
        "largest_timestep", max(step, measured.largest_timestep) if "timestep" not in simulation else step
    )
    if step > largest:
        raise simulation.error(f"timestep must be at most largest_timestep, got {step} and {largest} s")
    period = simulation.positive("largest_control_period", measured.largest_control_period)
    if largest > period:
        raise simulation.error(
            f"largest_timestep must be at most largest_control_period, got {largest} and {period} s"
        )
    return StepLimits(step, largest, period)


def _view(table: DescriptionTable) -> View | None:
    if "view" not in table:
        return None
    view = table.table("view", VIEW_KEYS)
    default = View(_camera(view, "overview"), _camera(view, "chase"))
    return replace(
        default, earth=view.vector("earth", 3, default.earth), sun=view.vector("sun", 3, default.sun)
    )


def _camera(view: DescriptionTable, key: str) -> tuple[Any, Any]:
    camera = view.table(key, ("position", "toward"))
    return camera.vector("position", 3), camera.vector("toward", 3)
