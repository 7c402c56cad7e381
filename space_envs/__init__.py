"""Gymnasium environments for free-floating space-robot capture; importing the package registers its ids."""

from space_envs.registration import register
from space_envs.robots.zoo import register_robot
from space_envs.system.provenance import package_version

__all__ = ["__version__", "register", "register_robot"]
__version__ = package_version()

register("SpaceCapture/SingleArm-v0", "space_envs.tasks.single_arm:SingleArmTask")
register("SpaceCapture/SingleArmCluttered-v0", "space_envs.tasks.single_arm_cluttered:SingleArmClutteredTask")
register("SpaceCapture/DualArmPlanar-v0", "space_envs.tasks.dual_arm_planar:DualArmPlanarTask")
register("SpaceCapture/DualArmSpatial-v0", "space_envs.tasks.dual_arm_spatial:DualArmSpatialTask")
