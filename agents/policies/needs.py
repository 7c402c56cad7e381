"""Needs that several policies share."""

from space_envs.policy import Needs

_ARM = ("joint_position", "joint_velocity", "base_position", "base_quaternion", "time")
POSE = Needs(
    fields=(*_ARM, "goal_position", "goal_quaternion", "position_error", "rotation_error"),
    control_modes=("joint_velocity",),
    arms=1,
    goals="static",
)
RENDEZVOUS = Needs(
    fields=(
        "joint_position",
        "joint_velocity",
        "base_position",
        "end_effector_position",
        "end_effector_linear_velocity",
        "target_position",
        "target_angular_velocity",
        "goal_position",
        "time",
    ),
    control_modes=("joint_velocity", "reactionless"),
    arms=2,
    goals="moving",
)
