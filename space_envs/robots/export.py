"""Robots' models for other tools: `python -m space_envs.robots.export --format urdf -o arm.urdf`.

MJCF is the whole model (robot, target, sensors, home pose). URDF holds the robot alone; its root link is
the satellite, with the origin at the satellite's centre of mass, and floats in whatever loads it: freely or,
for the planar robot, in the plane z = 0.
"""

import argparse
import sys
import xml.etree.ElementTree as ET
from collections.abc import Sequence

import mujoco
import numpy as np

from space_envs.errors import ConfigurationError, unknown_name
from space_envs.robots.models import (
    SATELLITE,
    SceneOptions,
    end_effectors,
    joint_names,
    robot_model,
    robot_spec,
)
from space_envs.robots.robot import Robot
from space_envs.robots.zoo import find_robot, robot_names
from space_envs.scenery.planet import make_plain
from space_envs.system.command_line import Parser, check_replaceable, exit_status, output_path
from space_envs.system.files import atomic_write_text

FORMATS = ("mjcf", "urdf")
DEFAULT = "shyam2020"


def mjcf(robot: Robot, visual: bool = False) -> str:
    """The model as MJCF text, with dynamic parameters in full precision.

    It is self-contained but for meshes of the robot's own files, which it names. A visible planet has one
    plain color, without clouds.
    """
    spec = robot_spec(robot, SceneOptions(visual=visual))
    if visual:
        make_plain(spec)
    model = spec.compile()
    root = ET.fromstring(spec.to_xml())
    _restore_digits(root, model)
    ET.indent(root)
    return f"{ET.tostring(root, encoding='unicode')}\n"


def _restore_digits(root: ET.Element, model: mujoco.MjModel) -> None:
    """Replace the numbers of MuJoCo's writer, which have six digits, by those of the compiled model."""
    for element in root.iter("body"):
        body = model.body(element.attrib["name"])
        element.attrib.update(pos=_text(body.pos), quat=_text(body.quat))
        inertial = element.find("inertial")
        if inertial is not None:
            inertial.attrib.update(
                pos=_text(body.ipos),
                quat=_text(body.iquat),
                mass=_text(body.mass),
                diaginertia=_text(body.inertia),
            )
        for site in element.findall("site"):
            site.attrib.update(
                pos=_text(model.site(site.attrib["name"]).pos),
                quat=_text(model.site(site.attrib["name"]).quat),
            )
        for joint in element.findall("joint[@range]"):
            compiled = model.joint(joint.attrib["name"])
            joint.attrib.update(range=_text(compiled.range), axis=_text(compiled.axis))
    for key in root.iter("key"):
        key.attrib["qpos"] = _text(model.key(key.attrib["name"]).qpos)


def urdf(robot: Robot) -> str:
    """The robot as URDF text: the satellite, links with inertia, hinges with limits, the end-effector frames.

    Links have the frames of the MuJoCo bodies of their names, rotated by the joint angles. URDF has no rotor
    inertia: that of the model is omitted.
    """
    model = robot_model(robot)
    rates = dict(zip(joint_names(robot), robot.rate_limit.tolist(), strict=True))
    tree = ET.Element("robot", name=robot.name)
    root = model.body(SATELLITE).id
    for number in range(model.nbody):  # MuJoCo numbers parents before their children
        if int(model.body_rootid[number]) != root:
            continue
        body = model.body(number)
        _add_link(tree, model, body.name)
        if number == root:
            continue
        joint = model.joint(int(body.jntadr[0]))
        parent = model.body(int(body.parentid[0])).name
        element = _add_joint(tree, joint.name, "revolute", parent, body.name, body.pos, body.quat)
        ET.SubElement(element, "axis", xyz=_text(joint.axis))
        ET.SubElement(
            element,
            "limit",
            lower=_text(joint.range[0]),
            upper=_text(joint.range[1]),
            velocity=_text(rates[joint.name]),
            effort=_text(model.actuator(joint.name).forcerange[1]),
        )
    for name in end_effectors(robot):
        site = model.site(name)
        parent = model.body(int(site.bodyid[0])).name
        ET.SubElement(tree, "link", name=name)
        _add_joint(tree, f"{name}_mount", "fixed", parent, name, site.pos, site.quat)
    ET.indent(tree)
    return f'<?xml version="1.0"?>\n{ET.tostring(tree, encoding="unicode")}\n'


def _text(values: float | Sequence[float] | np.ndarray) -> str:
    """Numbers with all digits."""
    return " ".join(repr(float(value) + 0.0) for value in np.atleast_1d(values))


def _add_link(robot: ET.Element, model: mujoco.MjModel, name: str) -> None:
    """Add a link, with its inertia in the axes of the link, since not every reader rotates it."""
    body = model.body(name)
    axes = np.zeros(9)
    mujoco.mju_quat2Mat(axes, body.iquat)
    rotation = axes.reshape(3, 3)
    inertia = rotation @ np.diag(body.inertia) @ rotation.T
    inertial = ET.SubElement(ET.SubElement(robot, "link", name=name), "inertial")
    ET.SubElement(inertial, "origin", xyz=_text(body.ipos), rpy="0 0 0")
    ET.SubElement(inertial, "mass", value=_text(body.mass))
    moments = {f"i{'xyz'[i]}{'xyz'[j]}": _text(inertia[i, j]) for i in range(3) for j in range(i, 3)}
    ET.SubElement(inertial, "inertia", moments)


def _add_joint(
    robot: ET.Element,
    name: str,
    kind: str,
    parent: str,
    child: str,
    position: np.ndarray,
    quaternion: np.ndarray,
) -> ET.Element:
    element = ET.SubElement(robot, "joint", name=name, type=kind)
    ET.SubElement(element, "origin", xyz=_text(position), rpy=_text(_roll_pitch_yaw(quaternion)))
    ET.SubElement(element, "parent", link=parent)
    ET.SubElement(element, "child", link=child)
    return element


def _roll_pitch_yaw(quaternion: np.ndarray) -> tuple[float, float, float]:
    """Fixed-axis angles (rad) of a quaternion (w, x, y, z), as URDF's rpy: Rz(yaw) Ry(pitch) Rx(roll)."""
    axes = np.zeros(9)
    mujoco.mju_quat2Mat(axes, quaternion)
    r = axes.reshape(3, 3)
    level = np.hypot(r[0, 0], r[1, 0])
    pitch = np.arctan2(-r[2, 0], level)
    # Where x points straight up or down, roll and yaw rotate about the same axis and any yaw is valid.
    yaw = np.arctan2(r[1, 0], r[0, 0]) if level > 1e-12 else 0.0
    across = np.cos(yaw) * r[1] - np.sin(yaw) * r[0]  # y axis of the frame that roll starts from
    return float(np.arctan2(-across[2], across[1])), float(pitch), float(yaw)


def export(file_format: str, robot: Robot, visual: bool = False) -> str:
    """Model of a robot as text in one of FORMATS, with or without the drawings.

    Raises:
        ConfigurationError: for an unknown format, or drawings in URDF, which could only name files of them.
    """
    if file_format not in FORMATS:
        raise unknown_name("model format", file_format, FORMATS)
    if file_format == "mjcf":
        return mjcf(robot, visual)
    if visual:
        raise ConfigurationError("URDF is exported without geometry; ask for mjcf, or leave out --visual")
    return urdf(robot)


def _parser() -> argparse.ArgumentParser:
    parser = Parser(
        prog="python -m space_envs.robots.export",
        description="Write a robot's model for other tools.",
        epilog="Lengths in m, masses in kg, angles in rad. See docs/physics.md for frames and variants.",
    )
    parser.add_argument(
        "--robot",
        default=DEFAULT,
        metavar="NAME|FILE",
        help=f"its description file, or one of {', '.join(robot_names())} (default: %(default)s)",
    )
    parser.add_argument("--variant", help="of the robot's inertias (default: its first)")
    parser.add_argument(
        "--format",
        default="mjcf",
        metavar="|".join(FORMATS),
        help="mjcf is the whole model, urdf the robot alone (default: %(default)s)",
    )
    parser.add_argument(
        "--visual", action="store_true", help="with the drawn geometry, lights and cameras (mjcf)"
    )
    parser.add_argument(
        "-o", "--output", type=output_path, metavar="FILE", help="where to write (default: print it)"
    )
    parser.add_argument("--overwrite", action="store_true", help="replace a file that is there")
    return parser


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; returns the exit status, 2 after a user error."""
    return exit_status("python -m space_envs.robots.export", lambda: _run(_parser().parse_args(arguments)))


def _run(options: argparse.Namespace) -> None:
    if options.output is not None:
        check_replaceable(options.output, options.overwrite)
    text = export(options.format, find_robot(options.robot, options.variant), options.visual)
    if options.output is None:
        sys.stdout.write(text)
    else:
        atomic_write_text(options.output, text)


if __name__ == "__main__":
    sys.exit(main())
