"""The page of a check: one HTML file that asks for nothing outside itself."""

import base64
import io
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from markupsafe import Markup
from PIL import Image

from space_envs.evaluation.records.names import display_name
from space_envs.evaluation.report.templating import make_environment, read_template, script_hash
from space_envs.robots.check.figures.robot_figures import RobotFigures
from space_envs.robots.check.implausible import Finding
from space_envs.robots.check.pictures import RobotPicture
from space_envs.robots.check.tables import FigureTable, headline
from space_envs.system.files import atomic_write_text
from space_envs.system.provenance import commit, versions

_PACKAGE = "space_envs.robots.check"
_QUALITY = 88  # of the pictures


@dataclass(frozen=True, eq=False)
class RobotReport:
    """Everything that a check found.

    Attributes:
        figures: of the robot. findings: what looks implausible. tables: of all figures, in the page's order.
        pictures: of the robot; pictures_note: why there are none. command: that made it.
    """

    figures: RobotFigures
    findings: Sequence[Finding]
    tables: Sequence[FigureTable]
    pictures: Sequence[RobotPicture]
    pictures_note: str
    command: str


def write_page(report: RobotReport, path: Path) -> None:
    """Write the page, whole or not at all."""
    atomic_write_text(path, to_html(report))


def to_html(report: RobotReport) -> str:
    """The page, self-contained."""
    robot, script = report.figures.robot, read_template("scrolling.js")
    arms = len(robot.arms)
    return (
        make_environment()
        .from_string(read_template("robot.html.j2", _PACKAGE))
        .render(
            title=display_name(robot.name, 200),
            chips=[
                (display_name(robot.variant), "variant"),
                (str(arms), "arm" if arms == 1 else "arms"),
                (str(robot.n_joints), "joints"),
                ("planar" if robot.planar else "spatial", "motion"),
            ],
            tiles=headline(report.figures),
            findings=report.findings,
            pictures=[{"title": each.title, "source": _data_url(each)} for each in report.pictures],
            pictures_note=report.pictures_note,
            tables=report.tables,
            notes=robot.notes,
            command=report.command,
            provenance=[("digest of the robot", robot.digest), ("commit", commit()), *versions().items()],
            style=Markup(read_template("report.css") + read_template("robot.css", _PACKAGE)),
            script=Markup(script),
            script_hash=script_hash(script),
        )
    )


def _data_url(picture: RobotPicture) -> str:
    content = io.BytesIO()
    Image.fromarray(picture.frame).save(content, format="JPEG", quality=_QUALITY)
    return f"data:image/jpeg;base64,{base64.b64encode(content.getvalue()).decode('ascii')}"
