"""Gymnasium environments for free-floating space-robot capture; importing the package registers its ids."""

from space_envs.registration import register

__all__ = ["register"]

register("SpaceCapture/SingleArm-v0", "space_envs.tasks.single_arm:SingleArmTask")
register("SpaceCapture/SingleArmCluttered-v0", "space_envs.tasks.single_arm_cluttered:SingleArmClutteredTask")
register("SpaceCapture/DualArmPlanar-v0", "space_envs.tasks.dual_arm_planar:DualArmPlanarTask")
register("SpaceCapture/DualArmSpatial-v0", "space_envs.tasks.dual_arm_spatial:DualArmSpatialTask")
