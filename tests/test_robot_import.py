"""Arms imported from URDF, against Pinocchio reading the same files."""

import numpy as np
import pytest
from imported_arms import example_robot, imported, mechanics

from space_envs.robots.description.arms import DescribedArm

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


LIMITS = {"rate": 0.5, "acceleration": 0.5, "torque": 50.0}


def example_arms(name: str) -> list[DescribedArm]:
    """Arms of an example robot."""
    tools, home, lock = ROBOTS[name]
    arm = {"file": str(example_robot(name)), "home": home, "lock": lock, "limits": LIMITS, "capsules": []}
    return imported(*(arm if tool is None else {**arm, "tool": tool} for tool in tools))


def locked_values(arms: list[DescribedArm], lock: dict[str, float]) -> dict[str, float]:
    """Values of the joints that are fixed, as the notes state them."""
    values = dict(lock)
    for note in arms[0].notes:
        if note.startswith("joints that are not between"):
            parts = note.split("fixed: ")[1].rstrip(".").split(", ")
            values |= {part.split(" at ")[0]: float(part.split(" at ")[1]) for part in parts}
    return values


@pytest.mark.parametrize("name", ROBOTS)
def test_momentum_is_that_of_pinocchio(name):
    """The mass matrix of the floating robot, with grippers locked, to ten digits."""
    pin = pytest.importorskip("pinocchio")
    arms = example_arms(name)
    robot = mechanics(arms)
    whole = pin.buildModelFromUrdf(str(example_robot(name)), pin.JointModelFreeFlyer())
    joints = [link.joint.name for arm in arms for link in arm.links]
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
