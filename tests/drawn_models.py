"""Checks that the tests of drawn models share."""

from collections.abc import Callable

import mujoco
import numpy as np


def assert_only_drawn(
    plain: mujoco.MjModel, drawn: mujoco.MjModel, disturb: Callable[[mujoco.MjData], None]
) -> None:
    """The drawn model is the plain one but for geometry that takes no part in the physics.

    `disturb` sets a motion going from the keyframe.
    """
    assert plain.ngeom == plain.ncam == plain.nlight == plain.ntex == plain.nmesh == 0
    assert drawn.ngeom > 100
    for name in (
        *("nq", "nv", "nu", "na", "nmocap", "nsensordata", "nsensor", "nbody", "nsite"),
        *("nkey", "neq", "nuserdata"),
    ):
        assert getattr(plain, name) == getattr(drawn, name), name
    for name in (
        *("body_mass", "body_inertia", "body_ipos", "body_iquat", "body_pos", "body_quat", "sensor_adr"),
        *("dof_armature", "jnt_range", "actuator_forcerange", "sensor_objid", "key_qpos"),
        *("site_pos", "site_quat"),
    ):
        np.testing.assert_array_equal(getattr(plain, name), getattr(drawn, name))
    assert not drawn.geom_contype.any()
    assert not drawn.geom_conaffinity.any()

    states = []
    for model in (plain, drawn):
        data = mujoco.MjData(model)
        mujoco.mj_resetDataKeyframe(model, data, 0)
        disturb(data)
        for _ in range(100):
            mujoco.mj_step(model, data)
        state = np.empty(mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_INTEGRATION))
        mujoco.mj_getState(model, data, state, mujoco.mjtState.mjSTATE_INTEGRATION)
        states.append(np.concatenate([state, data.sensordata]))
    np.testing.assert_array_equal(states[0], states[1])


def geoms(model: mujoco.MjModel, body: str, material: str = "") -> list[int]:
    """Geoms of a body whose material's name starts so."""
    return [
        geom
        for geom in range(model.ngeom)
        if model.geom_bodyid[geom] == model.body(body).id
        and model.mat(int(model.geom_matid[geom])).name.startswith(material)
    ]
