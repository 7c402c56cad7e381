"""The compiled model against the paper's tables, written out here from the paper's text."""

import json
from functools import partial
from math import pi
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from drawn_models import assert_only_drawn, geoms
from hypothesis import given, settings
from hypothesis import strategies as st

from space_envs.errors import ConfigurationError
from space_envs.robots.models import SceneOptions, robot_model
from space_envs.robots.zoo import find_robot

# Table I: alpha (rad), a (m), d (m).
TABLE_I = [
    (-pi / 2, 0.0, 0.5),
    (pi / 2, 0.0, 0.0),
    (pi / 2, 0.9, 0.0),
    (-pi / 2, 0.9, 0.0),
    (pi / 2, 0.8, 0.0),
    (-pi / 2, 0.8, 0.0),
    (pi / 2, 0.0, 0.8),
]
# Table II, satellite and links 1 to 7: mass (kg), Ix, Iy, Iz (kg m^2).
TABLE_II = [
    (200.0, 1400.0, 1400.0, 2040.0),
    (20.0, 0.10, 0.10, 0.10),
    (30.0, 0.25, 25.0, 25.0),
    (30.0, 0.25, 25.0, 25.0),
    (20.0, 0.25, 25.0, 25.0),
    (20.0, 0.25, 25.0, 25.0),
    (20.0, 0.25, 25.0, 25.0),
    (20.0, 0.25, 25.0, 25.0),
]
# The `physical` variant: rods of radius 0.08 m and a homogeneous cube of side 1 m. Axes of DH frame i; links
# 1 and 7 run along its y axis, links 3 to 6 along x, link 2 is as long as it is wide, about z.
AXIAL_20, AXIAL_30 = 0.064, 0.096
PHYSICAL_INERTIA = [
    (200 / 6, 200 / 6, 200 / 6),
    (0.032 + 5 / 12, AXIAL_20, 0.032 + 5 / 12),
    (0.112, 0.112, AXIAL_30),
    (AXIAL_30, 0.048 + 2.025, 0.048 + 2.025),
    (AXIAL_20, 0.032 + 1.35, 0.032 + 1.35),
    (AXIAL_20, 0.032 + 16 / 15, 0.032 + 16 / 15),
    (AXIAL_20, 0.032 + 16 / 15, 0.032 + 16 / 15),
    (0.032 + 16 / 15, AXIAL_20, 0.032 + 16 / 15),
]
HOME = (0.0, 5 * pi / 4, 0.0, 0.0, pi / 2, -pi / 2, 0.0)  # sec. VI
CASE = json.loads((Path(__file__).parent / "data" / "single_arm_home.json").read_text())
BODIES = ["satellite", *(f"link{i}" for i in range(1, 8))]


def rotation_x(angle: float) -> np.ndarray:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[1, 0, 0], [0, c, -s], [0, s, c]])


def rotation(quaternion: np.ndarray) -> np.ndarray:
    matrix = np.zeros(9)
    mujoco.mju_quat2Mat(matrix, quaternion)
    return matrix.reshape(3, 3)


def dh_frames(q: np.ndarray) -> list[np.ndarray]:
    """Frames 0 to 7 in the satellite's frame, 4 x 4, by standard Denavit-Hartenberg matrices."""
    frames = [np.eye(4)]
    for theta, (alpha, a, d) in zip(q, TABLE_I, strict=True):
        ct, st_, ca, sa = np.cos(theta), np.sin(theta), np.cos(alpha), np.sin(alpha)
        step = [
            [ct, -st_ * ca, st_ * sa, a * ct],
            [st_, ct * ca, -ct * sa, a * st_],
            [0, sa, ca, d],
            [0, 0, 0, 1],
        ]
        frames.append(frames[-1] @ np.array(step))
    return frames


def model_of(variant: str = "paper", **options: Any) -> mujoco.MjModel:
    return robot_model(find_robot("shyam2020", variant), SceneOptions(**options))


@pytest.fixture(params=["paper", "physical"])
def variant(request: pytest.FixtureRequest) -> str:
    return request.param


@pytest.mark.parametrize("visual", [False, True])
def test_masses_and_inertias_are_those_of_table_ii(variant: str, visual: bool) -> None:
    model = model_of(variant, visual=visual)
    assert [model.body(i).name for i in range(model.nbody)] == ["world", *BODIES, "target"]
    for number, name in enumerate(BODIES):
        body = model.body(name)
        assert body.mass[0] == TABLE_II[number][0]
        moments = TABLE_II[number][1:] if variant == "paper" else PHYSICAL_INERTIA[number]
        turn = (
            rotation_x(TABLE_I[number - 1][0]) if number else np.eye(3)
        )  # body axes from those of DH frame i
        axes = rotation(body.iquat)
        compiled = axes @ np.diag(body.inertia) @ axes.T
        np.testing.assert_allclose(compiled, turn @ np.diag(moments) @ turn.T, rtol=0, atol=1e-12)
    assert model.body("world").subtreemass[0] == 360.0  # 200 + 20 + 2 * 30 + 4 * 20; the target has no mass


def test_centres_of_mass_lie_mid_link(variant: str) -> None:
    model = model_of(variant)
    np.testing.assert_array_equal(model.body("satellite").ipos, np.zeros(3))
    for number, (_, a, d) in enumerate(TABLE_I, start=1):
        np.testing.assert_allclose(model.body(f"link{number}").ipos, [a / 2, 0, d / 2], rtol=0, atol=1e-15)


def test_physics_options(variant: str) -> None:
    options = model_of(variant, timestep=0.01).opt
    np.testing.assert_array_equal(options.gravity, np.zeros(3))
    assert int(options.integrator) == int(mujoco.mjtIntegrator.mjINT_RK4)
    assert options.timestep == 0.01
    assert int(options.disableflags) == 0
    assert options.density == options.viscosity == 0


def test_joints_and_actuators(variant: str) -> None:
    model = model_of(variant)
    assert (model.nq, model.nv, model.nu, model.na, model.nmocap) == (14, 13, 7, 0, 1)
    assert int(model.joint("satellite").type[0]) == int(mujoco.mjtJoint.mjJNT_FREE)
    for number in range(1, 8):
        joint, motor = model.joint(f"joint{number}"), model.actuator(f"joint{number}")
        assert int(joint.type[0]) == int(mujoco.mjtJoint.mjJNT_HINGE)
        np.testing.assert_array_equal(joint.axis, [0, 0, 1])
        np.testing.assert_array_equal(joint.pos, [0, 0, 0])
        assert joint.limited[0] == 1
        np.testing.assert_allclose(joint.range, [HOME[number - 1] - 3.0, HOME[number - 1] + 3.0], atol=1e-15)
        assert joint.damping[0] == joint.stiffness[0] == joint.frictionloss[0] == 0
        assert joint.armature[0] == (0.0 if variant == "paper" else 1.0)
        assert motor.trnid[0] == joint.id
        np.testing.assert_array_equal(motor.ctrlrange, [-60, 60])
        np.testing.assert_array_equal(motor.forcerange, [-60, 60])
        assert motor.ctrllimited[0] == motor.forcelimited[0] == 1
        assert motor.gear[0] == motor.gainprm[0] == 1
        assert not motor.biasprm.any()


@settings(deadline=None, max_examples=60)
@given(
    q=st.lists(st.floats(-pi, pi), min_size=7, max_size=7),
    base=st.lists(st.floats(-3, 3), min_size=3, max_size=3),
    turn=st.lists(st.floats(-1, 1), min_size=4, max_size=4).filter(lambda v: float(np.linalg.norm(v)) > 0.1),
)
def test_frames_are_the_dh_frames(q: list[float], base: list[float], turn: list[float]) -> None:
    model = model_of()
    data = mujoco.MjData(model)
    data.qpos[:] = [*base, *(np.array(turn) / np.linalg.norm(turn)), *q]
    mujoco.mj_kinematics(model, data)
    start = np.eye(4)
    start[:3, :3], start[:3, 3] = rotation(data.qpos[3:7]), base
    frames = [start @ frame for frame in dh_frames(np.array(q))]
    for number in range(1, 8):  # body i has its origin in frame i - 1 and the z axis of that frame
        body = data.body(f"link{number}")
        np.testing.assert_allclose(body.xpos, frames[number - 1][:3, 3], rtol=0, atol=1e-12)
        np.testing.assert_allclose(
            body.xmat.reshape(3, 3)[:, 2], frames[number - 1][:3, 2], rtol=0, atol=1e-12
        )
    site = data.site("end_effector")
    np.testing.assert_allclose(site.xpos, frames[7][:3, 3], rtol=0, atol=1e-12)
    np.testing.assert_allclose(site.xmat.reshape(3, 3), frames[7][:3, :3], rtol=0, atol=1e-12)


def test_home_pose_and_matrices_of_the_case() -> None:
    model = model_of()
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key("home").id)
    mujoco.mj_forward(model, data)
    np.testing.assert_allclose(data.qpos, [0, 0, 0, 1, 0, 0, 0, *HOME], rtol=0, atol=1e-15)
    np.testing.assert_allclose(data.qpos[7:], CASE["q_home_rad"], rtol=0, atol=1e-12)
    tolerance = {"rtol": 0, "atol": CASE["tolerance_absolute"]}
    site = data.site("end_effector")
    np.testing.assert_allclose(site.xpos, CASE["ee_home_m"], **tolerance)
    np.testing.assert_allclose(site.xmat.reshape(3, 3), CASE["R_home"], **tolerance)

    mass = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, mass)
    base_map = -np.linalg.solve(mass[:6, :6], mass[:6, 6:])  # the base is upright: body axes are world axes
    np.testing.assert_allclose(base_map, CASE["base_map_home"], **tolerance)
    jacobian = np.zeros((6, model.nv))
    mujoco.mj_jacSite(model, data, jacobian[:3], jacobian[3:], site.id)
    np.testing.assert_allclose(jacobian[:, 6:] + jacobian[:, :6] @ base_map, CASE["gjm_home"], **tolerance)


def test_drawing_changes_nothing_that_is_simulated(variant: str) -> None:
    plain = model_of(variant)
    drawn = model_of(variant, visual=True)

    def disturb(data: mujoco.MjData) -> None:
        data.ctrl[:] = [9, -20, 15, 5, -8, 3, 30]

    assert_only_drawn(plain, drawn, disturb)


def test_what_is_drawn_stands_where_the_frames_say() -> None:
    model = model_of(visual=True)
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_kinematics(model, data)
    data.mocap_pos[0] = data.site("end_effector").xpos
    mujoco.mju_mat2Quat(data.mocap_quat[0], data.site("end_effector").xmat)
    mujoco.mj_kinematics(model, data)

    def distance(first: list[int], second: list[int]) -> float:
        pairs = [(a, b) for a in first for b in second]
        return min(mujoco.mj_geomDistance(model, data, a, b, 5.0, None) for a, b in pairs)

    # At capture the bar is between the pads without touching them, and the hand is clear of the debris.
    own = partial(geoms, model)
    bar, pads = own("target", "warning"), [g for g in own("link7", "warning") if model.geom_type[g] == 6]
    assert len(bar) == 1
    assert len(pads) == 2
    np.testing.assert_allclose(data.geom_xpos[bar[0]], data.site("end_effector").xpos, atol=1e-12)
    for pad in pads:
        assert 0 < distance([pad], bar) < 0.03
    assert distance(own("link7"), own("target", "silver") + own("target", "white")) > 0.05
    # The wings are well below the arm at home, and each link is drawn from its own frame to the next.
    arm = [geom for number in range(3, 8) for geom in own(f"link{number}")]
    assert distance(own("satellite", "solar"), arm) > 0.3
    for number in (3, 4, 5, 6):
        boom = next(g for g in own(f"link{number}", "white") if model.geom_type[g] == 5)
        middle = (data.body(f"link{number}").xpos + data.body(f"link{number + 1}").xpos) / 2
        np.testing.assert_allclose(data.geom_xpos[boom], middle, atol=1e-12)


@pytest.mark.parametrize(
    ("keywords", "message"),
    [
        ({"variant": "papre"}, "Did you mean 'paper'"),
        ({"timestep": 0.0}, "timestep must be a finite positive number of at most 0.1"),
        ({"timestep": float("nan")}, "timestep must be a finite positive number of at most 0.1"),
        ({"timestep": 0.2}, "timestep must be a finite positive number of at most 0.1"),
    ],
)
def test_bad_options_are_refused(keywords: dict, message: str) -> None:
    with pytest.raises(ConfigurationError, match=message):
        model_of(**keywords)
