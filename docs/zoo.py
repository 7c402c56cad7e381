"""Tables of the zoo for docs/robots.md: names, figures and pictures of all robots."""

import re
from importlib.resources import files
from pathlib import Path

from docs.reading import table
from space_envs.robots.robot import Robot
from space_envs.robots.zoo import find_robot

COLUMNS = 3  # of pictures
FOLDER = Path(str(files("space_envs") / "robots" / "zoo"))


def zoo() -> list[str]:
    """Names of the robots of this package, without those that somebody registered."""
    return sorted(file.stem for file in FOLDER.glob("*.toml"))


def robots() -> str:
    """Robots with what their files say they are, ids that take them, masses and reach."""
    rows = []
    for name in zoo():
        robot = find_robot(name)
        arms = sum(link.inertial.mass for link in robot.links)
        rows.append(
            (
                f"`{name}`",
                _title(name),
                _tasks(robot),
                " + ".join(str(len(arm.links)) for arm in robot.arms),
                f"{robot.satellite.inertial.mass:.4g}",
                f"{arms:.3g}",
                f"{robot.reach:.2f}",
            )
        )
    head = ("name", "what it is", "ids", "joints", "satellite, kg", "arms, kg", "length of an arm, m")
    return table(head, rows)


def robot_pictures() -> str:
    """Pictures of all robots at home."""
    names = zoo()
    cells = [f"![{_title(name)}](images/robots/{name}.jpg)<br>`{name}`" for name in names]
    cells += [""] * (-len(cells) % COLUMNS)
    lines = [cells[i : i + COLUMNS] for i in range(0, len(cells), COLUMNS)]
    head = ["|" + " |" * COLUMNS, "|" + "---|" * COLUMNS]
    return "\n".join([*head, *("| " + " | ".join(line) + " |" for line in lines)])


def _title(name: str) -> str:
    """First sentence of the comment that a robot's file begins with."""
    text = (FOLDER / f"{name}.toml").read_text(encoding="utf-8")
    comment = " ".join(
        line.lstrip("# ") for line in text.split("\n\n")[0].splitlines() if line.startswith("#")
    )
    return re.split(r"\.(?: |$)", comment)[0]


def _tasks(robot: Robot) -> str:
    if len(robot.arms) == 1:
        return "single arm"
    return "two arms, planar" if robot.planar else "two arms, in space"
