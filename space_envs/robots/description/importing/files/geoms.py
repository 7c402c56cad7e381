"""Geoms of a compiled MuJoCo model as shapes."""

import mujoco
import numpy as np

from space_envs.robots.pose import Pose
from space_envs.robots.robot import Visual

# Others, such as planes and height fields, are no part of a robot.
KINDS = {
    int(mujoco.mjtGeom.mjGEOM_BOX): "box",
    int(mujoco.mjtGeom.mjGEOM_SPHERE): "sphere",
    int(mujoco.mjtGeom.mjGEOM_CYLINDER): "cylinder",
    int(mujoco.mjtGeom.mjGEOM_CAPSULE): "capsule",
    int(mujoco.mjtGeom.mjGEOM_ELLIPSOID): "ellipsoid",
    int(mujoco.mjtGeom.mjGEOM_MESH): "mesh",
}


def geom_pose(model: mujoco.MjModel, geom: int) -> Pose:
    """Pose of a geom in its body."""
    return Pose.of(np.array(model.geom_pos[geom]), np.array(model.geom_quat[geom]))


def geom_visual(model: mujoco.MjModel, geom: int) -> Visual:
    """A geom as it is drawn; a mesh without its file."""
    pose = geom_pose(model, geom)
    material = int(model.geom_matid[geom])
    colour = model.geom_rgba[geom] if material < 0 else model.mat_rgba[material]
    red, green, blue, opacity = (round(float(value), 6) for value in colour)
    x, y, z = (float(value) for value in model.geom_size[geom])
    return Visual(
        KINDS[int(model.geom_type[geom])],
        (x, y, z),
        pose.vector,
        pose.quaternion,
        colour=(red, green, blue, opacity),
    )
