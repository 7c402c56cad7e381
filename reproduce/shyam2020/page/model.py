"""Tables I and II of the paper, read back from the compiled model."""

from dataclasses import dataclass
from math import pi

import mujoco
import numpy as np

from reproduce.page.blocks import Table
from reproduce.shyam2020.page.text import TEXT
from space_envs.dynamics.rotations import Array, to_matrix
from space_envs.robots.models import SATELLITE, robot_model
from space_envs.robots.zoo import find_robot

# As printed: alpha rad, a m, d m; then mass kg and Ix, Iy, Iz kg m^2, link 0 being the satellite.
TABLE_I = (
    (-pi / 2, 0.0, 0.5),
    (pi / 2, 0.0, 0.0),
    (pi / 2, 0.9, 0.0),
    (-pi / 2, 0.9, 0.0),
    (pi / 2, 0.8, 0.0),
    (-pi / 2, 0.8, 0.0),
    (pi / 2, 0.0, 0.8),
)
TABLE_II = (
    (200.0, 1400.0, 1400.0, 2040.0),
    (20.0, 0.10, 0.10, 0.10),
    (30.0, 0.25, 25.0, 25.0),
    (30.0, 0.25, 25.0, 25.0),
    (20.0, 0.25, 25.0, 25.0),
    (20.0, 0.25, 25.0, 25.0),
    (20.0, 0.25, 25.0, 25.0),
    (20.0, 0.25, 25.0, 25.0),
)
HOME = (0.0, 5 * pi / 4, 0.0, 0.0, pi / 2, -pi / 2, 0.0)  # rad, section VI


@dataclass(frozen=True)
class CompiledModel:
    """Parameters of the compiled model, as in Tables I and II.

    Attributes:
        frames: (7, 3) alpha rad, a m, d m. bodies: (8, 4) mass kg and inertia kg m^2 in the axes of DH frame
            i. products: kg m^2, largest product of inertia in those axes. home: (7,) rad, of the keyframe.
        end_effector: (3,) m, at home in the base frame.
    """

    frames: Array
    bodies: Array
    products: float
    home: Array
    end_effector: Array


def compiled() -> CompiledModel:
    """Parameters of the compiled model of variant `paper`."""
    model = robot_model(find_robot("shyam2020", "paper"))
    names = [f"link{i}" for i in range(1, 8)]
    satellite = model.body(SATELLITE)
    inertias, masses, frames = [_inertia(satellite.inertia, satellite.iquat)], [satellite.mass[0]], []
    for i, name in enumerate(names):
        # Where joint i + 1 sits in the body of joint i: Tz(d) Tx(a) Rx(alpha).
        after = model.body(names[i + 1]) if i + 1 < len(names) else model.site("end_effector")
        rotation = to_matrix(after.quat)
        frames.append([np.arctan2(rotation[2, 1], rotation[1, 1]), after.pos[0], after.pos[2]])
        body = model.body(name)
        inertias.append(rotation.T @ _inertia(body.inertia, body.iquat) @ rotation)
        masses.append(body.mass[0])
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_forward(model, data)
    return CompiledModel(
        np.array(frames),
        np.array([[mass, *np.diag(inertia)] for mass, inertia in zip(masses, inertias, strict=True)]),
        max(map(_product, inertias)),
        data.qpos[7:].copy(),
        data.site("end_effector").xpos.copy(),
    )


def _inertia(principal: Array, axes: Array) -> Array:
    rotation = to_matrix(axes)
    return rotation @ np.diag(principal) @ rotation.T


def _product(inertia: Array) -> float:
    return float(np.abs(inertia - np.diag(np.diag(inertia))).max())


def model_tables() -> tuple[Table, Table]:
    """Tables I and II as compiled."""
    found = compiled()
    frames = [
        (str(i + 1), f"{alpha / pi:+.3g} π", f"{a:g}", f"{d:g}", f"θ{i + 1}", f"{found.home[i] / pi:.4g} π")
        for i, (alpha, a, d) in enumerate(found.frames.round(12).tolist())
    ]
    names = ("satellite", *(f"link {i}" for i in range(1, 8)))
    bodies = [
        (name, *(f"{value:g}" for value in row))
        for name, row in zip(names, found.bodies.round(12).tolist(), strict=True)
    ]
    frames_text = TEXT.fill(
        "tables.frames",
        worst=np.abs(found.frames - TABLE_I).max(),
        home=np.abs(found.home - HOME).max(),
        end_effector=found.end_effector,
    )
    bodies_text = TEXT.fill(
        "tables.bodies", worst=np.abs(found.bodies - TABLE_II).max(), products=found.products
    )
    return Table(**frames_text, rows=frames), Table(**bodies_text, rows=bodies)
