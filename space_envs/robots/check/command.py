"""`python -m space_envs.robots check`: figures of a robot, what looks implausible, and tests on it."""

import argparse
import shlex
from collections.abc import Sequence
from pathlib import Path

from rich import box
from rich.console import Console
from rich.table import Table
from rich.text import Text
from tqdm import tqdm

from space_envs.errors import positive_integer
from space_envs.evaluation.records.names import display_name
from space_envs.evaluation.report.tables.terminal import print_at, width_of
from space_envs.robots.check.figures.goals import SPLIT, task_of
from space_envs.robots.check.figures.robot_figures import RobotFigures, robot_figures
from space_envs.robots.check.implausible import Finding, implausible
from space_envs.robots.check.page import RobotReport, write_page
from space_envs.robots.check.pictures import robot_pictures
from space_envs.robots.check.planners import planner_figures
from space_envs.robots.check.tables import FigureTable, figure_tables, planner_table, verification_table
from space_envs.robots.check.verification import Verification, verify
from space_envs.robots.robot import Robot
from space_envs.robots.zoo import find_robot
from space_envs.step_limits.measured import measured_steps
from space_envs.system.command_line import AppendValues, Parser, output_path

DESCRIPTION = """\
Measure a robot: masses and reach, conditioning of its generalised Jacobian and of the reaction null space,
the largest time step that conserves momentum, tracking, attitude, and the share of goals that each built-in
planner reaches; say what looks implausible; print it all and write it as a page.
"""
GOALS = 20
_WORDS = 110  # columns of text


def parser() -> argparse.ArgumentParser:
    """The command line."""
    out = Parser(
        prog="python -m space_envs.robots check",
        description=DESCRIPTION,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add = out.add_argument
    add("robot", metavar="ROBOT", help="name of a robot, or its description, a TOML file")
    add("--variant", help="of the robot's inertias (default: its first)")
    add("--goals", type=int, default=GOALS, help=f"validation goals for each planner (default {GOALS})")
    what = "policies to try on it, as those of evaluate.py (default experts: every planner that fits)"
    add("--planners", action=AppendValues, nargs="+", default=["experts"], metavar="NAME", help=what)
    add("--no-planners", action="store_true", help="do not run the planners")
    add("--no-pictures", action="store_true", help="do not draw the robot")
    add("--test", action="store_true", help="run the suite's tests on it; the status is 1 if one fails")
    what = "page to write (default NAME_check.html, with the robot's name)"
    add("--output", type=output_path, metavar="FILE", help=what)
    return out


def run(arguments: Sequence[str]) -> int:
    """Check a robot; returns the exit status: 1 if a test failed.

    Raises:
        SpaceEnvsError: for a description that is not valid, or planners that cannot be run.
    """
    options = parser().parse_args(arguments)
    positive_integer("--goals", options.goals, 1000)
    robot = find_robot(options.robot, options.variant, measured_steps)
    console = Console()
    figures = robot_figures(robot)
    findings = implausible(figures)
    _print_figures(console, figures, findings)
    tables = list(figure_tables(figures))
    env_id = None if figures.goals else task_of(robot)
    tests = _tests(robot, env_id) if options.test else []
    more = [verification_table(tests)] if tests else []
    if not options.no_planners and env_id is not None:
        reached = planner_figures(options.robot, env_id, options.goals, options.planners, options.variant)
        more.append(planner_table(reached, SPLIT))
    for table in more:
        _print_table(console, table)
    _write(options, figures, findings, [*tables, *more], arguments)
    return int(any(test.passed is False for test in tests))


def _tests(robot: Robot, env_id: str | None) -> list[Verification]:
    return list(tqdm(verify(robot, env_id), unit="test", desc="tests", leave=False))


def _write(
    options: argparse.Namespace,
    figures: RobotFigures,
    findings: Sequence[Finding],
    tables: Sequence[FigureTable],
    arguments: Sequence[str],
) -> None:
    pictures, note = ([], "") if options.no_pictures else robot_pictures(figures.robot)
    command = f"python -m space_envs.robots check {shlex.join(arguments)}"
    path = options.output or Path(f"{_file_name(figures.robot.name)}_check.html")
    write_page(RobotReport(figures, findings, tables, pictures, note, command), path)
    print(f"Page: {path}")


def _file_name(name: str) -> str:
    return "".join(letter if letter.isalnum() or letter in "-_" else "_" for letter in name)


def _print_figures(console: Console, figures: RobotFigures, findings: Sequence[Finding]) -> None:
    for table in figure_tables(figures):
        _print_table(console, table)
    lines = [Text(f"Note: {note}", style="dim") for note in figures.robot.notes]
    lines += [Text(f"Implausible ({finding.rule}): {finding.text}", style="yellow") for finding in findings]
    if not findings:
        lines.append(Text("Nothing looks implausible.", style="green"))
    for line in lines:
        print_at(console, line, min(width_of(console), _WORDS))


def _print_table(console: Console, table: FigureTable) -> None:
    width = width_of(console)
    shown = Table(box=box.SIMPLE_HEAD, header_style="bold", pad_edge=False, title_justify="left")
    for number, head in enumerate(table.heads):
        shown.add_column(head, justify="left" if number == 0 else "right", vertical="bottom")
    for row in table.rows:
        shown.add_row(*(Text(display_name(cell, 200) if cell else "") for cell in row))
    print_at(console, Text(table.title, style="bold"), width)
    print_at(console, shown, width)
    if table.caption:
        print_at(console, Text(table.caption, style="dim"), min(width, _WORDS))
    print_at(console, Text(""), width)
