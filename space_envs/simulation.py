"""Named views of N simulations of one robot: a thin layer over `mujoco.batch.Batch`."""

import os
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from space_envs.dynamics.rotations import Array, to_matrix
from space_envs.dynamics.tree import base_kind
from space_envs.system.forking import Pool, notify_after_fork

Rows = NDArray[np.int64]

STAGE_VEL = mujoco.mjtStage.mjSTAGE_VEL
STAGE_POS = mujoco.mjtStage.mjSTAGE_POS
STAGE_NONE = mujoco.mjtStage.mjSTAGE_NONE
# Fields of a batch that are bound, by attribute of the simulation.
_VIEWS = {
    **{name: name for name in ("qpos", "qvel", "ctrl", "mocap_pos", "mocap_quat")},
    "sensors": "sensordata",
    "mass_entries": "M",
    "_bias": "qfrc_bias",
}
# Fields of a batch that may differ between simulations.
_OWN_FIELDS = ("body_mass", "body_inertia", "dof_damping", "dof_armature", "site_pos")
_ONE_THREAD_UP_TO = 8  # simulations; below this, handing work to threads costs more than it saves


class Simulation:
    """N simulations of a free-floating robot with n joints.

    The base's own joints are the model's first ones: a free joint in space, two slides and a hinge in the
    plane. The robot's hinges follow them, and then the other joints. The robot's generalised velocity is
    [v0 in inertial axes; w0 in base axes; joint rates], its base part having b = 6 components or, in the
    plane, b = 3.

    Attributes:
        planar: whether the base moves in the plane only.
        n_base: b. angular: slice of w0 in the generalised velocity.
        qpos (N, nq), qvel (N, nv), ctrl (N, n): live and writable.
        mocap_pos (N, k, 3), mocap_quat (N, k, 4): likewise, of the k mocap bodies.
        sensors (N, ns): live, current after `step` and `refresh`.
        mass_entries (N, k): likewise, stored entries of the mass matrix, of which `dense` makes matrices.
        mass_factor (N, n + 1): factors on the masses and inertias of the base and the links, as last set.
        moments (N, n + 1, 3): their principal moments of inertia at factor 1, kg m^2; None are the model's.
        watch: called after every step of the simulation.

    Args:
        threads: None is a default that depends on N.
        fields: of `mujoco.MjData` that become attributes (N, ...), live like the sensors.
    """

    def __init__(
        self, model: mujoco.MjModel, n: int, threads: int | None = None, fields: tuple[str, ...] = ()
    ) -> None:
        if threads is None:
            threads = 1 if n <= _ONE_THREAD_UP_TO else min(len(os.sched_getaffinity(0)), 16)
        self.model = model
        self.n = n
        self.n_joints = model.nu
        self._base = int(model.jnt_bodyid[0])
        self._views = _VIEWS | {name: name for name in fields}
        self.planar = base_kind(model, self._base) == "planar"
        self.n_base = 3 if self.planar else 6
        self.angular = slice(2, 3) if self.planar else slice(3, 6)
        self._first = 3 if self.planar else 7  # joint angle in qpos
        self._attitude = slice(2, 3) if self.planar else slice(3, 7)  # in qpos
        self._open(threads)
        self._mass_index, self._mass_present = _dense_index(model, self.n_base + self.n_joints)
        self._bodies = np.flatnonzero(model.body_rootid == self._base)
        self.mass_factor, self.moments = np.ones((n, len(self._bodies))), None
        self._warned, self._all_warned = np.zeros(n, dtype=np.int64), 0
        self.watch: Callable[[], None] | None = None

    mass_factor: Array
    moments: Array | None
    batch: Pool
    qpos: Array
    qvel: Array
    ctrl: Array
    mocap_pos: Array
    mocap_quat: Array
    sensors: Array
    qfrc_applied: Array  # of those that ask for it
    mass_entries: Array
    _bias: Array

    def _open(self, threads: int) -> None:
        """Create the batch and bind its fields."""
        self.batch = Pool(self.model, self.n, threads)
        if self.batch.nthread > 1:
            notify_after_fork(self)
        for attribute, name in self._views.items():
            setattr(self, attribute, self.batch.bind(name))

    def after_fork(self) -> None:
        """Set the batch aside in a forked child, since its threads exist in the parent only."""
        if "batch" in self.__dict__:
            self._inherited = self.batch
            for name in ("batch", *self._views):
                del self.__dict__[name]

    if not TYPE_CHECKING:  # type checkers must find missing attributes

        def __getattr__(self, name: str) -> Any:
            """Create a new batch in the state of the one that was set aside."""
            inherited = self.__dict__.pop("_inherited", None)
            if inherited is None:
                raise AttributeError(f"{type(self).__name__!r} object has no attribute {name!r}")
            self.batch = inherited
            snapshot = self.snapshot()
            self._open(inherited.nthread)
            self.restore(snapshot)
            return getattr(self, name)

    @property
    def joint_position(self) -> Array:
        """(N, n) rad, a view."""
        return self.qpos[:, self._first : self._first + self.n_joints]

    @property
    def joint_velocity(self) -> Array:
        """(N, n) rad/s, a view."""
        return self.qvel[:, self.n_base : self.n_base + self.n_joints]

    @property
    def base_attitude(self) -> Array:
        """Quaternion (N, 4) of the base or, in the plane, its angle (N, 1) rad; a view."""
        return self.qpos[:, self._attitude]

    def robot_state(self) -> tuple[Array, Array]:
        """qpos (N, 7 + n) and qvel (N, 6 + n) of the robot as one in space with a free joint, copies."""
        if not self.planar:
            size = 7 + self.n_joints
            return self.qpos[:, :size].copy(), self.qvel[:, : size - 1].copy()
        qpos, qvel = np.zeros((self.n, 7 + self.n_joints)), np.zeros((self.n, 6 + self.n_joints))
        qpos[:, :2], qpos[:, 7:] = self.qpos[:, :2], self.joint_position
        qpos[:, 3], qpos[:, 6] = np.cos(0.5 * self.qpos[:, 2]), np.sin(0.5 * self.qpos[:, 2])
        qvel[:, :2], qvel[:, 5], qvel[:, 6:] = self.qvel[:, :2], self.qvel[:, 2], self.joint_velocity
        return qpos, qvel

    def mass_matrix(self) -> Array:
        """Mass matrix (N, b + n, b + n) of the robot in generalised velocities, a copy."""
        return self.dense(self.mass_entries)

    def dense(self, entries: Array) -> Array:
        """Symmetric matrices (K, b + n, b + n) of stored entries (K, k) of the mass matrix."""
        mass = entries.take(self._mass_index, axis=1)
        if self._mass_present is not None:
            mass *= self._mass_present
        return mass

    def base_rows(self) -> Array:
        """Rows (N, b, b + n) of the base in the mass matrix, a copy."""
        return self.mass_entries.take(self._mass_index[: self.n_base], axis=1)

    def base_inertias(self) -> tuple[Array, Array]:
        """Base inertia (N, b, b) and coupling inertia (N, b, n): rows of the mass matrix, copies."""
        rows = self.base_rows()
        return rows[:, :, : self.n_base], rows[:, :, self.n_base :]

    def bias(self) -> Array:
        """Coriolis and centrifugal forces (N, b + n) of the robot."""
        return self._bias[:, : self.n_base + self.n_joints]

    def step(self, substeps: int, rows: Rows | None = None) -> Array:
        """Advance all simulations, or rows (k,), and make their sensors, mass matrix and bias current.

        Returns:
            Attitudes of the base, or its angles in the plane, after every step, (N or k, substeps, 4 or 1).
        """
        at = slice(None) if rows is None else rows
        if rows is not None and not len(rows):
            return np.empty((0, substeps, self.base_attitude.shape[1]))
        if self.watch is not None:
            return np.stack([self._step_once(rows, self.watch)[at] for _ in range(substeps)], axis=1)
        if substeps == 1:
            self.batch.step(ids=rows, nstep=1, stage=STAGE_VEL)
            return self.base_attitude[at, None]
        passed = self.batch.rollout(substeps - 1, record=["qpos"], ids=rows)["qpos"]
        self.batch.step(ids=rows, nstep=1, stage=STAGE_VEL)
        return np.concatenate([passed[..., self._attitude], self.base_attitude[at, None]], axis=1)

    def _step_once(self, rows: Rows | None, watch: Callable[[], None]) -> Array:
        """Attitudes (N, 4 or 1) after one step, which `watch` has seen; many give the same bits as `step`."""
        self.batch.step(ids=rows, nstep=1, stage=STAGE_VEL)
        watch()
        return self.base_attitude.copy()

    def refresh(self, rows: Rows | None = None) -> None:
        """Update derived quantities after the state was set."""
        self.batch.forward(ids=rows, stage=STAGE_VEL)

    def reset(self, rows: Rows) -> None:
        """Put rows (k,) into the keyframe `home`, at rest; derived quantities follow at `refresh`."""
        self.batch.reset(ids=rows, keyframe=0, stage=STAGE_NONE)
        self._warned[rows] = self.batch.warning[rows, :, 1].sum(axis=1)
        self._all_warned = self._warned.sum()

    def inertia(self) -> Array | None:
        """Inertias (N, n + 1, 3, 3) of the base and the links at factor 1, in the bodies' axes, kg m^2; None
        if they are the model's."""
        if self.moments is None:
            return None
        axes = to_matrix(self.model.body_iquat[self._bodies])
        return axes @ (self.moments[..., None] * axes.swapaxes(1, 2))

    @property
    def nominal_moments(self) -> Array:
        """Principal moments of inertia (n + 1, 3) of the base and the links in the model, kg m^2."""
        return self.model.body_inertia[self._bodies]

    def scale_base(self, rows: Rows, scale: Array) -> None:
        """Multiply the satellite's mass and inertia of rows (k,) by scale (k,), from the model's values."""
        if self.batch.expanded("body_mass") is None and (scale == 1.0).all():
            return
        factor = np.ones((len(rows), len(self._bodies)))
        factor[:, 0] = scale
        self.set_masses(rows, factor)

    def set_masses(self, rows: Rows, factor: Array, moments: Array | None = None) -> None:
        """Give the base and the links of rows (k,) other masses and inertias than the model's.

        Args:
            factor: (k, n + 1) on masses and inertias. moments: (k, n + 1, 3) principal moments of inertia at
                the factor 1, kg m^2; None are the model's.
        """
        self.mass_factor[rows] = factor
        nominal = self.nominal_moments
        if moments is not None:
            if self.moments is None:
                self.moments = np.tile(nominal, (self.n, 1, 1))
            self.moments[rows] = nominal = moments
        at = rows[:, None], self._bodies
        self.batch.expand("body_mass")[at] = self.model.body_mass[self._bodies] * factor
        self.batch.expand("body_inertia")[at] = nominal * factor[..., None]
        self.batch.set_const(rows)

    def set_joints(self, rows: Rows, viscous: Array, inertia: Array) -> None:
        """Give the joints of rows (k,) friction and inertia in addition to the model's.

        Args:
            viscous, inertia: (k, n) N m s/rad and kg m^2.
        """
        joints = np.arange(self.n_base, self.n_base + self.n_joints)
        for name, values in (("dof_damping", viscous), ("dof_armature", inertia)):
            self.batch.expand(name)[rows[:, None], joints] = getattr(self.model, name)[joints] + values
        self.batch.set_const(rows)

    def warned(self) -> bool:
        """Whether any simulation has warned since it was reset; cheaper than `diverged`."""
        return self.batch.warning[:, :, 1].sum() > self._all_warned

    def diverged(self) -> NDArray[np.bool_]:
        """(N,) bool: MuJoCo found a bad state since the last reset and silently started over."""
        return self.batch.warning[:, :, 1].sum(axis=1) > self._warned

    def set_base_velocity(self, rows: Rows) -> None:
        """Give the base of rows (k,) the velocity that makes total momentum zero with the joint rates set."""
        self.refresh(rows)
        mass, b = self.dense(self.mass_entries[rows]), self.n_base
        momentum = mass[:, :b, b:] @ self.joint_velocity[rows][..., None]
        self.qvel[rows, :b] = -np.linalg.solve(mass[:, :b, :b], momentum)[..., 0]

    def place_sites(self, rows: Rows, names: tuple[str, ...], position: Array) -> None:
        """Put sites of rows (k,) at positions (k, s, 3) in their bodies, m."""
        sites = [self.model.site(name).id for name in names]
        self.batch.expand("site_pos")[rows[:, None], sites] = position

    def snapshot(self) -> dict[str, Array]:
        """State from which `restore` continues bitwise identically."""
        state = {"state": np.stack([self.state(row) for row in range(self.n)])}
        for name in _OWN_FIELDS:
            own = self.batch.expanded(name)
            if own is not None:
                state[name] = own.copy()
        return state

    def restore(self, snapshot: dict[str, Array]) -> None:
        """Restore a snapshot of the same number of simulations of the same model."""
        rows = np.arange(self.n)
        data = mujoco.MjData(self.model)
        own = [name for name in _OWN_FIELDS if name in snapshot]
        for name in own:
            self.batch.expand(name)[:] = snapshot[name]
        if own:
            self.batch.set_const(rows)
        for row, state in enumerate(snapshot["state"]):
            mujoco.mj_setState(self.model, data, state, mujoco.mjtState.mjSTATE_INTEGRATION)
            for name in ("qpos", "qvel", "ctrl", "mocap_pos", "mocap_quat", "qacc_warmstart", "time"):
                self.batch.bind(name)[row] = getattr(data, name)
        self.refresh()
        self._warned = self.batch.warning[:, :, 1].sum(axis=1)
        self._all_warned = self._warned.sum()

    def state(self, row: int) -> Array:
        """Integration state of one simulation, for `mujoco.mj_setState`."""
        data = self.batch.get_data(row)
        state = np.empty(mujoco.mj_stateSize(self.model, mujoco.mjtState.mjSTATE_INTEGRATION))
        mujoco.mj_getState(self.model, data, state, mujoco.mjtState.mjSTATE_INTEGRATION)
        return state


def _dense_index(model: mujoco.MjModel, size: int) -> tuple[NDArray[np.int64], NDArray[np.float64] | None]:
    """Indices of M's leading (size, size) block in its sparse lower triangle.

    Also (size, size) ones and zeros where branches leave entries out, which then point at any other entry;
    None where there are no such entries.
    """
    index = np.full((size, size), -1, dtype=np.int64)
    for row in range(size):
        start = int(model.M_rowadr[row])
        for place in range(start, start + int(model.M_rownnz[row])):
            column = int(model.M_colind[place])
            index[row, column] = index[column, row] = place
    present = index >= 0
    index[~present] = 0
    return index, None if present.all() else present.astype(np.float64)
