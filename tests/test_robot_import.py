"""Arms imported from URDF, against Pinocchio reading the same files."""

from typing import Any

import numpy as np
import pytest
from imported_arms import BOX, FACE, example_robot, mechanics

from space_envs.robots.description.importing.arms import import_arms
from space_envs.robots.description.importing.source import ArmSource, ImportedArms

PANDA, UR5 = "panda_description/urdf/panda.urdf", "ur_description/urdf/ur5_robot.urdf"
UR10, XARM7 = "ur_description/urdf/ur10_robot.urdf", "xarm_description/urdf/xarm7.urdf"
Z1, KINOVA = "z1_description/urdf/z1.urdf", "kinova_description/robots/kinova.urdf"
TIAGO = "tiago_description/robots/tiago_dual.urdf"
# File -> tools and home of its arms, and the joints that are locked.
ROBOTS = {
    PANDA: (["panda_hand_tcp"], [0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785], {"panda_finger_joint1": 0.02}),
    UR5: (["tool0"], [0.0, -1.5, 1.5, 0.0, 1.5, 0.0], {}),
    UR10: (["tool0"], [0.0, -1.5, 1.5, 0.0, 1.5, 0.0], {}),
    XARM7: ([None], [0.0, -0.5, 0.0, 1.5, 0.0, 1.0, 0.0], {}),
    Z1: (["link06"], [0.0, 1.0, -1.0, 0.0, 0.0, 0.0], {"jointGripper": -0.5}),
    KINOVA: (["j2s6s200_end_effector"], [0.0, 2.9, 1.3, 0.0, 1.0, 0.0], {}),
    TIAGO: (
        ["arm_left_tool_link", "arm_right_tool_link"],
        [0.0, 0.2, 1.0, 1.0, 0.5, 0.2, 0.1],
        {"torso_lift_joint": 0.1},
    ),
}


def imported(name: str, **options: Any) -> ImportedArms:
    """Arms of an example robot, without a contact shape."""
    tools, home, lock = ROBOTS[name]
    file = example_robot(name)
    options = {"contacts": False, "home": home, "lock": lock, **options}
    return import_arms([ArmSource(file, tool=tool, **options) for tool in tools], BOX)


def locked_values(arms: ImportedArms, lock: dict[str, float]) -> dict[str, float]:
    """Values of the joints that are fixed, as the notes state them."""
    values = dict(lock)
    for note in arms.notes:
        if " joints that are not between" in note:
            parts = note.split("fixed: ")[1].rstrip(".").split(", ")
            values |= {part.split(" at ")[0]: float(part.split(" at ")[1]) for part in parts}
    return values


@pytest.mark.parametrize("name", ROBOTS)
def test_momentum_is_that_of_pinocchio(name):
    """The mass matrix of the floating robot, with grippers locked, to ten digits."""
    pin = pytest.importorskip("pinocchio")
    arms = imported(name)
    robot = mechanics(arms.fixed, arms.arms)
    whole = pin.buildModelFromUrdf(str(example_robot(name)), pin.JointModelFreeFlyer())
    joints = [link.joint.name for arm in arms.arms for link in arm.links]
    still = pin.neutral(whole)
    for joint, value in locked_values(arms, ROBOTS[name][2]).items():
        index = whole.joints[whole.getJointId(joint)]
        still[index.idx_q] = value if index.nq == 1 else 1.0
    reduced = pin.buildReducedModel(
        whole, [i for i, other in enumerate(whole.names) if i > 1 and other not in joints], still
    )
    rng = np.random.default_rng(3)
    for _ in range(3):
        angles = rng.uniform(-1.5, 1.5, len(joints))
        position, columns = pin.neutral(reduced), []
        for joint, angle in zip(joints, angles, strict=True):
            index = reduced.joints[reduced.getJointId(joint)]
            wrapped = [np.cos(angle), np.sin(angle)] if index.nq == 2 else [angle]
            position[index.idx_q : index.idx_q + index.nq] = wrapped
            columns.append(index.idx_v)
        mass = np.triu(pin.crba(reduced, reduced.createData(), position))[:6]
        base, coupling = robot.momentum_matrices(angles)
        np.testing.assert_allclose(np.triu(base), mass[:, :6], rtol=1e-10, atol=1e-10 * base.max())
        np.testing.assert_allclose(coupling, mass[:, columns], rtol=1e-10, atol=1e-10 * base.max())


def test_mount_moves_what_is_fixed_and_the_first_link_alone():
    free, mounted = imported(XARM7), imported(XARM7, position=FACE, orientation=(0.0, 1.0, 0.0, 0.0))
    assert free.arms[0].links[1:] == mounted.arms[0].links[1:]
    np.testing.assert_allclose(
        mounted.fixed.centre, np.array([1, -1, -1]) * free.fixed.centre + np.array(FACE), atol=1e-12
    )
