"""The robots with two arms of the built-in ids, and names in their models."""

from space_envs.robots.zoo import find_robot

DUAL_ARMS = {"planar": find_robot("shah2013"), "spatial": find_robot("spatial_dual_arm")}
END_EFFECTORS = ("end_effector1", "end_effector2")
