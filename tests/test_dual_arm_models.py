"""The compiled dual-arm models against shah2013's Table I and what else defines them, written out here."""

from copy import copy
from math import pi
from typing import Any

import mujoco
import numpy as np
import pytest
from drawn_models import assert_only_drawn, geoms
from dual_arm_robots import DUAL_ARMS, END_EFFECTORS

from space_envs.errors import ConfigurationError, RenderingError
from space_envs.rendering import Renderer, missing_gl
from space_envs.robots.models import GRAPPLES, SceneOptions, robot_model
from space_envs.scenery.dual_arm import scale_target

# shah2013, Table I: satellite and each link of either arm.
SATELLITE_MASS, SATELLITE_IZZ = 500.0, 83.61  # kg, kg m^2
LINK_LENGTH, LINK_MASS, LINK_IZZ = 1.0, 10.0, 1.05  # m, kg, kg m^2
MOUNTS = ((0.5, 0.0), (-0.5, 0.0))  # m, the public demo with the same Table I
# The canonical start: joint angles, and end-effectors computed from them elsewhere, to six digits.
CANONICAL_THETA = (0.0, 1.8, -1.5, 0.9, -0.6, 1.0)  # rad
CANONICAL_END_EFFECTORS = ((2.228134, 1.269368), (1.344445, 2.042405))  # m
# Each spatial arm is shyam2020's Table I at half scale: alpha (rad), a, d (m); masses are half, too (kg).
SPATIAL_DH = [
    (-pi / 2, 0.0, 0.25),
    (pi / 2, 0.0, 0.0),
    (pi / 2, 0.45, 0.0),
    (-pi / 2, 0.45, 0.0),
    (pi / 2, 0.4, 0.0),
    (-pi / 2, 0.4, 0.0),
    (pi / 2, 0.0, 0.4),
]
SPATIAL_MASS = (10.0, 15.0, 15.0, 10.0, 10.0, 10.0, 10.0)
# Solid rods of radius 0.05 m in the axes of DH frame i: links 1 and 7 run along its y axis, links 3 to 6
# along x, link 2 is as long as it is wide, about z. Transverse: m (3 r^2 + l^2) / 12, axial: m r^2 / 2.
AXIAL_10, AXIAL_15 = 0.0125, 0.01875
SPATIAL_INERTIA = [
    (0.00625 + 10 * 0.25**2 / 12, AXIAL_10, 0.00625 + 10 * 0.25**2 / 12),
    (0.009375 + 0.0125, 0.009375 + 0.0125, AXIAL_15),
    (AXIAL_15, 0.009375 + 15 * 0.45**2 / 12, 0.009375 + 15 * 0.45**2 / 12),
    (AXIAL_10, 0.00625 + 10 * 0.45**2 / 12, 0.00625 + 10 * 0.45**2 / 12),
    (AXIAL_10, 0.00625 + 10 * 0.4**2 / 12, 0.00625 + 10 * 0.4**2 / 12),
    (AXIAL_10, 0.00625 + 10 * 0.4**2 / 12, 0.00625 + 10 * 0.4**2 / 12),
    (0.00625 + 10 * 0.4**2 / 12, AXIAL_10, 0.00625 + 10 * 0.4**2 / 12),
]
# rad, m, kg and kg m^2; our choice.
HOME = {
    "planar": (-0.9, 1.4, 0.6, 1.4, -0.5, -0.6),
    "spatial": (
        *(-1.17, -1.86, -1.23, 2.10, 0.21, -0.22, 0.17),
        *(-1.85, -1.80, -1.49, 1.12, 0.10, 0.81, 0.41),
    ),
}
FORWARD = 0.35  # m, of the spatial mounts from the middle of their faces
HALF_WIDTH = 0.3  # m, of the grapple points from the target's centre
TARGET_MASS = {"planar": 100.0, "spatial": 120.0}
TARGET_INERTIA = {"planar": (10.0, 10.0, 10.0), "spatial": (12.0, 16.0, 20.0)}
FREE, SLIDE, HINGE = (
    int(kind)
    for kind in (mujoco.mjtJoint.mjJNT_FREE, mujoco.mjtJoint.mjJNT_SLIDE, mujoco.mjtJoint.mjJNT_HINGE)
)


def model_of(kind: str, **options: Any) -> mujoco.MjModel:
    return robot_model(DUAL_ARMS[kind], SceneOptions(**options))


def joint_names(model: mujoco.MjModel) -> list[str]:
    return [f"arm{arm}_joint{number}" for arm in (1, 2) for number in range(1, model.nu // 2 + 1)]


def posed(model: mujoco.MjModel, theta: np.ndarray) -> mujoco.MjData:
    """The satellite in the origin, upright, with these joint angles."""
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key("home").id)
    first = int(model.joint("arm1_joint1").qposadr[0])
    data.qpos[first : first + model.nu] = theta
    mujoco.mj_forward(model, data)
    return data


def turn(axis: int, angle: float) -> np.ndarray:
    """Homogeneous rotation about x (0), y (1) or z (2)."""
    c, s = np.cos(angle), np.sin(angle)
    matrix = np.eye(4)
    i, j = (axis + 1) % 3, (axis + 2) % 3
    matrix[[i, i, j, j], [i, j, i, j]] = c, -s, s, c
    return matrix


def shift(x: float, y: float, z: float) -> np.ndarray:
    matrix = np.eye(4)
    matrix[:3, 3] = x, y, z
    return matrix


def inertia_in_body(model: mujoco.MjModel, name: str) -> np.ndarray:
    body = model.body(name)
    axes = np.zeros(9)
    mujoco.mju_quat2Mat(axes, body.iquat)
    return axes.reshape(3, 3) @ np.diag(body.inertia) @ axes.reshape(3, 3).T


@pytest.mark.parametrize("visual", [False, True])
def test_the_planar_robot_is_that_of_table_i(visual: bool) -> None:
    model = model_of("planar", visual=visual)
    links = [f"arm{arm}_link{number}" for arm in (1, 2) for number in (1, 2, 3)]
    assert [model.body(i).name for i in range(model.nbody)] == ["world", "satellite", *links, "target"]
    assert model.body("satellite").mass[0] == SATELLITE_MASS
    assert inertia_in_body(model, "satellite")[2, 2] == SATELLITE_IZZ
    np.testing.assert_array_equal(model.body("satellite").ipos, np.zeros(3))
    for arm, mount in zip((1, 2), MOUNTS, strict=True):
        for number in (1, 2, 3):
            body = model.body(f"arm{arm}_link{number}")
            assert body.mass[0] == LINK_MASS
            assert inertia_in_body(model, body.name)[2, 2] == LINK_IZZ
            np.testing.assert_array_equal(body.ipos, [LINK_LENGTH / 2, 0, 0])
            place = [*mount, 0.0] if number == 1 else [LINK_LENGTH, 0.0, 0.0]
            np.testing.assert_array_equal(body.pos, place)
            np.testing.assert_array_equal(body.quat, [1, 0, 0, 0])
            parent = "satellite" if number == 1 else f"arm{arm}_link{number - 1}"
            assert model.body(int(body.parentid[0])).name == parent
        site = model.site(f"end_effector{arm}")
        assert model.body(int(site.bodyid[0])).name == f"arm{arm}_link3"
        np.testing.assert_array_equal(site.pos, [LINK_LENGTH, 0, 0])


def test_the_spatial_robot_has_rods_as_links_and_a_cube_as_bus() -> None:
    model = model_of("spatial")
    assert model.body("satellite").mass[0] == 500.0
    np.testing.assert_allclose(inertia_in_body(model, "satellite"), 500 / 6 * np.eye(3), rtol=1e-15)
    for arm in (1, 2):
        rows = zip(SPATIAL_DH, SPATIAL_MASS, SPATIAL_INERTIA, strict=True)
        for number, ((alpha, a, d), mass, moments) in enumerate(rows, start=1):
            body = model.body(f"arm{arm}_link{number}")
            assert body.mass[0] == mass
            np.testing.assert_allclose(body.ipos, [a / 2, 0, d / 2], rtol=0, atol=1e-15)
            axes = turn(0, alpha)[:3, :3]  # body axes from those of DH frame i
            expected = axes @ np.diag(moments) @ axes.T
            np.testing.assert_allclose(inertia_in_body(model, body.name), expected, rtol=0, atol=1e-14)


def test_frames_of_the_spatial_arms_are_dh_frames() -> None:
    model = model_of("spatial")
    generator = np.random.default_rng(0)
    for _ in range(20):
        theta = generator.uniform(-pi, pi, 14)
        data = posed(model, theta)
        for arm, sign in ((1, 1.0), (2, -1.0)):
            # Frame 0: z out of the face at +x or -x.
            frame = shift(sign * 0.5, FORWARD, 0.0) @ turn(1, sign * pi / 2)
            np.testing.assert_allclose(frame[:3, 2], [sign, 0, 0], atol=1e-15)
            angles = theta[7 * (arm - 1) : 7 * arm]
            for number, (angle, (alpha, a, d)) in enumerate(zip(angles, SPATIAL_DH, strict=True), start=1):
                body = data.body(f"arm{arm}_link{number}")
                np.testing.assert_allclose(body.xpos, frame[:3, 3], rtol=0, atol=1e-12)
                np.testing.assert_allclose(body.xmat.reshape(3, 3)[:, 2], frame[:3, 2], rtol=0, atol=1e-12)
                frame = frame @ turn(2, angle) @ shift(a, 0, d) @ turn(0, alpha)
            site = data.site(f"end_effector{arm}")
            np.testing.assert_allclose(site.xpos, frame[:3, 3], rtol=0, atol=1e-12)
            np.testing.assert_allclose(site.xmat.reshape(3, 3), frame[:3, :3], rtol=0, atol=1e-12)


@pytest.mark.parametrize("kind", DUAL_ARMS)
def test_joints_actuators_and_physics(kind: str) -> None:
    model = model_of(kind, timestep=0.01)
    n = 6 if kind == "planar" else 14
    floating = [SLIDE, SLIDE, HINGE] if kind == "planar" else [FREE]
    assert [int(t) for t in model.jnt_type] == [*floating, *([HINGE] * n), *floating]
    assert (model.nu, model.na, model.nmocap, model.neq) == (n, 0, 0, 0)
    assert [model.actuator(i).name for i in range(n)] == joint_names(model)
    for number, name in enumerate(joint_names(model)):
        joint, motor = model.joint(name), model.actuator(name)
        np.testing.assert_array_equal(joint.axis, [0, 0, 1])
        np.testing.assert_array_equal(joint.pos, [0, 0, 0])
        assert joint.damping[0] == joint.stiffness[0] == joint.frictionloss[0] == 0
        reach = 2.9 if kind == "spatial" else 3.1 if number % 3 == 0 else 2.7
        np.testing.assert_array_equal(joint.range, [-reach, reach])
        assert joint.armature[0] == (0.5 if kind == "spatial" else 0.0)
        assert motor.trnid[0] == joint.id
        assert motor.gear[0] == motor.gainprm[0] == 1
        np.testing.assert_array_equal(motor.forcerange, [-60, 60])
    np.testing.assert_array_equal(model.opt.gravity, np.zeros(3))
    assert int(model.opt.integrator) == int(mujoco.mjtIntegrator.mjINT_RK4)
    assert model.opt.timestep == 0.01
    assert model.opt.density == model.opt.viscosity == 0
    first = int(model.joint("arm1_joint1").qposadr[0])
    home = model.key("home").qpos
    np.testing.assert_array_equal(home[first : first + n], HOME[kind])
    np.testing.assert_array_equal(home[:first], [0, 0, 0, 1, 0, 0, 0][:first])
    limits = model.jnt_range[[model.joint(name).id for name in joint_names(model)]]
    assert (np.abs(home[first : first + n]) < limits[:, 1] - 0.3).all()


@pytest.mark.parametrize("kind", DUAL_ARMS)
def test_the_target_has_a_grapple_point_on_either_side(kind: str) -> None:
    model = model_of(kind)
    body = model.body("target")
    assert int(body.parentid[0]) == 0
    assert body.mass[0] == TARGET_MASS[kind]
    np.testing.assert_allclose(inertia_in_body(model, "target"), np.diag(TARGET_INERTIA[kind]), atol=1e-14)
    np.testing.assert_array_equal(body.ipos, np.zeros(3))
    half = HALF_WIDTH
    places = [[0, -half, 0], [0, half, 0]] if kind == "planar" else [[half, 0, 0], [-half, 0, 0]]
    for name, place in zip(GRAPPLES, places, strict=True):
        site = model.site(name)
        assert model.body(int(site.bodyid[0])).name == "target"
        np.testing.assert_array_equal(site.pos, place)
        if kind == "spatial":  # z is the way in
            axes = np.zeros(9)
            mujoco.mju_quat2Mat(axes, site.quat)
            np.testing.assert_allclose(axes.reshape(3, 3)[:, 2], -np.array(place) / half, atol=1e-15)


def test_end_effectors_of_the_canonical_start() -> None:
    data = posed(model_of("planar"), np.array(CANONICAL_THETA))
    for name, place in zip(END_EFFECTORS, CANONICAL_END_EFFECTORS, strict=True):
        np.testing.assert_allclose(data.site(name).xpos, [*place, 0.0], rtol=0, atol=5.1e-7)


def test_the_arms_can_be_mounted_elsewhere() -> None:
    mounts = ((0.3, 0.2), (-0.4, 0.1))
    usual, moved = model_of("planar"), robot_model(DUAL_ARMS["planar"].mounted_at(mounts))
    for index, name in enumerate(END_EFFECTORS):
        offset = posed(moved, np.array(CANONICAL_THETA)).site(name).xpos
        offset = offset - posed(usual, np.array(CANONICAL_THETA)).site(name).xpos
        np.testing.assert_allclose(offset[:2], np.subtract(mounts[index], MOUNTS[index]), atol=1e-15)
    assert DUAL_ARMS["planar"].mounted_at(MOUNTS) == DUAL_ARMS["planar"]


@pytest.mark.parametrize("kind", DUAL_ARMS)
def test_drawing_changes_nothing_that_is_simulated(kind: str) -> None:
    plain, drawn = model_of(kind), model_of(kind, visual=True)
    cameras = {drawn.cam(i).name for i in range(drawn.ncam)}
    assert cameras == {"overview", "chase", *END_EFFECTORS}

    def disturb(data: mujoco.MjData) -> None:
        data.ctrl[:] = np.linspace(-3, 3, drawn.nu)
        data.qvel[-1] = 0.05

    assert_only_drawn(plain, drawn, disturb)


def heights(model: mujoco.MjModel, data: mujoco.MjData, which: list[int]) -> tuple[float, float]:
    """Least and largest z of the boxes around geoms, m."""
    axes = data.geom_xmat[which].reshape(-1, 3, 3)[:, 2]
    middle = data.geom_xpos[which, 2] + (axes * model.geom_aabb[which, :3]).sum(axis=1)
    half = (np.abs(axes) * model.geom_aabb[which, 3:]).sum(axis=1)
    return float((middle - half).min()), float((middle + half).max())


@pytest.mark.parametrize("kind", DUAL_ARMS)
def test_what_is_drawn_stands_where_the_frames_say(kind: str) -> None:
    model = model_of(kind, visual=True)
    data = posed(model, np.array(HOME[kind]))
    last = 3 if kind == "planar" else 7
    for arm in (1, 2):
        for number in range(1, last + 1):  # housings of joints are centred on their axes
            body = data.body(f"arm{arm}_link{number}")
            centred = [g for g in geoms(model, body.name) if np.allclose(data.geom_xpos[g], body.xpos)]
            cylinders = [g for g in centred if model.geom_type[g] == int(mujoco.mjtGeom.mjGEOM_CYLINDER)]
            axes = data.geom_xmat[cylinders].reshape(-1, 3, 3)[:, :, 2]
            assert len(cylinders) == 2
            np.testing.assert_allclose(axes, np.tile(body.xmat.reshape(3, 3)[:, 2], (2, 1)), atol=1e-12)
        # Fingers close around the end-effector, of which the palm stays clear.
        site = data.site(f"end_effector{arm}")
        hand = geoms(model, f"arm{arm}_link{last}", "warning")
        pads = [g for g in hand if model.geom_type[g] == int(mujoco.mjtGeom.mjGEOM_BOX)]
        assert len(pads) == 3
        np.testing.assert_allclose(np.linalg.norm(data.geom_xpos[pads] - site.xpos, axis=1), 0.023, atol=1e-3)
    for name in GRAPPLES:  # a knob in each grapple point
        distance = np.linalg.norm(data.geom_xpos[geoms(model, "target")] - data.site(name).xpos, axis=1)
        assert distance.min() < 1e-12
    if kind == "planar":  # the arms turn above the bus
        arms = [geom for body in range(2, 8) for geom in geoms(model, model.body(body).name)]
        bus = [geom for geom in geoms(model, "satellite") if model.geom_dataid[geom] < 0]  # meshes lie inside
        assert heights(model, data, bus)[1] <= heights(model, data, arms)[0] + 1e-9


@pytest.mark.parametrize("kind", DUAL_ARMS)
def test_the_drawn_target_is_scaled_with_its_half_width(kind: str) -> None:
    shared = model_of(kind, visual=True)
    model = copy(shared)
    mine = np.isin(np.arange(model.ngeom), geoms(model, "target"))
    assert mine.sum() > 60
    assert (shared.geom_dataid[mine] == -1).all()  # meshes could not be scaled
    nominal = float(np.linalg.norm(shared.site("grapple1").pos))
    for half_width in (0.45, 0.2):  # one after the other
        scale_target(model, half_width)
        ratio = half_width / nominal
        for name in ("geom_pos", "geom_size"):
            before, after = getattr(shared, name), getattr(model, name)
            np.testing.assert_allclose(after[mine], ratio * before[mine], rtol=1e-12, atol=1e-15)
            np.testing.assert_array_equal(after[~mine], before[~mine])
        for name in (*GRAPPLES, "target"):
            place = ratio * shared.site(name).pos
            np.testing.assert_allclose(model.site(name).pos, place, rtol=1e-12, atol=1e-15)
        for name in END_EFFECTORS:
            np.testing.assert_array_equal(model.site(name).pos, shared.site(name).pos)
    for bad in (0.0, -1.0, float("nan"), float("inf")):
        with pytest.raises(ConfigurationError, match="half_width must be positive"):
            scale_target(model, bad)


@pytest.mark.parametrize("kind", DUAL_ARMS)
def test_the_renderer_shows_the_target_at_its_size(kind: str) -> None:
    plain = model_of(kind)
    data = mujoco.MjData(plain)
    mujoco.mj_resetDataKeyframe(plain, data, 0)
    if kind == "planar":
        data.qpos[-3:-1] = 2.0, 1.0
    state = np.empty(mujoco.mj_stateSize(plain, mujoco.mjtState.mjSTATE_INTEGRATION))
    mujoco.mj_getState(plain, data, state, mujoco.mjtState.mjSTATE_INTEGRATION)
    with Renderer(model_of(kind, visual=True), width=120, height=120) as renderer:
        if missing_gl() is not None:
            with pytest.raises(RenderingError):
                renderer.render(state)
            return
        nominal = renderer.render(state).astype(int)
        views = [renderer.render(state, camera).astype(int) for camera in ("chase", *END_EFFECTORS)]
        changed = []
        for half_width in (0.4, 0.2):
            scale_target(renderer.model, half_width)
            changed.append((renderer.render(state) != nominal).any(axis=-1).mean())
        scale_target(renderer.model, 0.3)
        assert (renderer.render(state) != nominal).any(axis=-1).mean() < 0.001
    assert all(0.001 < share < 0.2 for share in changed)
    assert all((view != nominal).mean() > 0.2 for view in views)
