"""A free-floating robot as numbers: a tree of hinged links, read from a compiled MuJoCo model."""

import hashlib
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Self

import mujoco
import numpy as np
from numpy.typing import NDArray

from space_envs.dynamics.rotations import Array
from space_envs.errors import ConfigurationError


@dataclass(frozen=True, eq=False)
class RobotTree:
    """A free-floating base, in space or in the plane z = 0, and a tree of links on hinges.

    Body 0 is the base; link i = 1..n carries joint i - 1. A robot in the plane is one in space whose motion
    never leaves the plane: twists and momenta keep six components, three of which are zero.

    Attributes:
        parent: (n,) body that carries link i.
        offset, mounting: (n, 3) m and (n, 3, 3): pose of link i in its parent at joint angle zero.
        hinge: (n, 3) joint axis in the link's frame.
        rotor_inertia: (n,) kg m^2 behind the gears; it adds to the joints' inertia alone.
        mass: (n + 1,) kg. com: (n + 1, 3) m, in the body's frame.
        inertia: (n + 1, 3, 3) kg m^2 about the centre of mass, in the body's axes.
        end_effector_link: (k,) body of each end-effector. end_effector_offset, end_effector_mounting: its
            pose in that body.
        range: (n, 2) rad, joint limits; infinite where there are none.
        home: (n,) rad, keyframe `home` of the model.
    """

    parent: NDArray[np.int64]
    offset: Array
    mounting: Array
    hinge: Array
    rotor_inertia: Array
    mass: Array
    com: Array
    inertia: Array
    end_effector_link: NDArray[np.int64]
    end_effector_offset: Array
    end_effector_mounting: Array
    range: Array
    home: Array

    def __post_init__(self) -> None:
        # Compiled code is cached by content, so the content must not change.
        for field in fields(self):
            array = getattr(self, field.name).copy()
            array.setflags(write=False)
            object.__setattr__(self, field.name, array)

    @classmethod
    def from_model(
        cls,
        model: mujoco.MjModel,
        base: str = "satellite",
        end_effectors: tuple[str, ...] = ("end_effector",),
    ) -> Self:
        """Read the robot whose base body is `base` from a compiled model.

        Raises:
            ConfigurationError: if there is no such body, site or keyframe, the base does not float, a
                link does not hang on exactly one hinge through its frame's origin, or an end-effector is not
                on a link.
        """
        root = _id(model, mujoco.mjtObj.mjOBJ_BODY, base)
        members = [b for b in range(model.nbody) if model.body_rootid[b] == root]
        if base_kind(model, root) is None:
            raise ConfigurationError(f"body {base!r} is not a free-floating base")
        links = members[1:]
        index = {body: number for number, body in enumerate(members)}
        joints = []
        for body in links:
            joint = int(model.body_jntadr[body])
            single = int(model.body_jntnum[body]) == 1
            if (
                not single
                or int(model.jnt_type[joint]) != int(mujoco.mjtJoint.mjJNT_HINGE)
                or model.jnt_pos[joint].any()
            ):
                raise ConfigurationError(
                    f"link {model.body(body).name!r} must hang on one hinge through its frame's origin"
                )
            joints.append(joint)
        principal = _matrices(model.body_iquat[members])
        sites = [_id(model, mujoco.mjtObj.mjOBJ_SITE, name) for name in end_effectors]
        for name, site in zip(end_effectors, sites, strict=True):
            if int(model.site_bodyid[site]) not in links:
                raise ConfigurationError(f"end-effector {name!r} is not on a link of {base!r}")
        qpos_home = model.key_qpos[_id(model, mujoco.mjtObj.mjOBJ_KEY, "home")]
        limited = model.jnt_limited[joints].astype(bool)[:, None]
        return cls(
            parent=np.array([index[int(model.body_parentid[b])] for b in links], dtype=np.int64),
            offset=model.body_pos[links],
            mounting=_matrices(model.body_quat[links]),
            hinge=model.jnt_axis[joints],
            rotor_inertia=model.dof_armature[model.jnt_dofadr[joints]],
            mass=model.body_mass[members],
            com=model.body_ipos[members],
            inertia=principal @ (model.body_inertia[members][:, :, None] * principal.swapaxes(1, 2)),
            end_effector_link=np.array([index[int(model.site_bodyid[s])] for s in sites], dtype=np.int64),
            end_effector_offset=model.site_pos[sites],
            end_effector_mounting=_matrices(model.site_quat[sites]),
            range=np.where(limited, model.jnt_range[joints], [-np.inf, np.inf]),
            home=qpos_home[model.jnt_qposadr[joints]],
        )

    @property
    def n_joints(self) -> int:
        """Number of joints n."""
        return len(self.parent)

    @cached_property
    def fingerprint(self) -> str:
        """SHA-256 of all parameters of the robot, for caches."""
        digest = hashlib.sha256()
        for field in fields(self):
            array = getattr(self, field.name)
            digest.update(f"{field.name} {array.shape} {array.dtype.str};".encode())
            digest.update(array.tobytes())
        return digest.hexdigest()

    @cached_property
    def carries(self) -> Array:
        """(n, n) one where joint j moves link i: rows are joints, columns links."""
        carries = np.zeros((self.n_joints, self.n_joints))
        for link in range(self.n_joints):
            body = link + 1
            while body > 0:
                carries[body - 1, link] = 1.0
                body = int(self.parent[body - 1])
        return carries

    def joint_array(self, values: Array, name: str = "joint positions") -> Array:
        """The values as float64 of shape (..., n).

        Raises:
            ConfigurationError: if the last axis is not the joints.
        """
        values = np.asarray(values, dtype=np.float64)
        if values.ndim == 0 or values.shape[-1] != self.n_joints:
            raise ConfigurationError(f"{name} must have shape (..., {self.n_joints}), got {values.shape}")
        return values


def base_kind(model: mujoco.MjModel, body: int) -> str | None:
    """Kind of a base: `spatial` (free joint), `planar` (slides along x, y, hinge about z), or None."""
    first, count = int(model.body_jntadr[body]), int(model.body_jntnum[body])
    kinds = [int(kind) for kind in model.jnt_type[first : first + count]]
    free, slide, hinge = (
        int(kind)
        for kind in (mujoco.mjtJoint.mjJNT_FREE, mujoco.mjtJoint.mjJNT_SLIDE, mujoco.mjtJoint.mjJNT_HINGE)
    )
    if kinds == [free]:
        return "spatial"
    axes = model.jnt_axis[first : first + count]
    through_origin = not model.jnt_pos[first : first + count].any()
    if kinds == [slide, slide, hinge] and (axes == np.eye(3)).all() and through_origin:
        return "planar"
    return None


def _id(model: mujoco.MjModel, kind: mujoco.mjtObj, name: str) -> int:
    number = mujoco.mj_name2id(model, kind, name)
    if number < 0:
        raise ConfigurationError(
            f"the model has no {kind.name.removeprefix('mjOBJ_').lower()} named {name!r}"
        )
    return number


def _matrices(quaternions: Array) -> Array:
    out = np.empty((len(quaternions), 9))
    for row, quaternion in zip(out, quaternions, strict=True):
        mujoco.mju_quat2Mat(row, quaternion)
    return out.reshape(-1, 3, 3)
