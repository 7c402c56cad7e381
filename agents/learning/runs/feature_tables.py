"""Features that the networks of each id see, and those that suit any other observation."""

from agents.policies.learned.features import IN_BASE_AXES, Feature, has_base_axes
from space_envs.tasks.common import ObservationLayout

# What the return still depends on: the time until the horizon and the score of a capture.
_EPISODE = (Feature("time", "plain", 20.0), Feature("peak_attitude", "plain", 0.02))

SINGLE_ARM_FEATURES = (
    Feature("joint_position", "from_home", 0.5),
    Feature("joint_velocity", "plain", 0.2),
    Feature("base_quaternion", "rotation", 0.1),
    Feature("base_linear_velocity", "base_axes", 0.05),
    Feature("base_angular_velocity", "base_axes", 0.05),
    Feature("end_effector_position", "from_base", 1.0),
    Feature("end_effector_linear_velocity", "base_axes", 0.2),
    Feature("end_effector_angular_velocity", "base_axes", 0.2),
    Feature("position_error", "base_axes", 0.5),
    Feature("rotation_error", "base_axes", 0.5),
    Feature("position_error", "bearing", 0.1),
    Feature("rotation_error", "bearing", 0.2),
    *_EPISODE,
)
CLUTTERED_FEATURES = (
    *SINGLE_ARM_FEATURES,
    Feature("obstacle_position", "from_base", 1.0),
    Feature("obstacle_radius", "plain", 0.3),
)
PLANNER_FEATURES = tuple(
    Feature(field, kind, scale)
    for field in ("position_error", "rotation_error")
    for kind, scale in (("base_axes", 0.5), ("bearing", 0.2), ("root", 0.5))
)
DUAL_PLANAR_FEATURES = (
    Feature("joint_position", "from_home", 0.5),
    Feature("joint_velocity", "plain", 0.2),
    Feature("base_angle", "plain", 0.02),
    Feature("base_linear_velocity", "base_axes", 0.02),
    Feature("base_angular_velocity", "plain", 0.02),
    Feature("end_effector_position", "from_base", 1.0),
    Feature("end_effector_linear_velocity", "base_axes", 0.2),
    Feature("goal_linear_velocity", "base_axes", 0.02),
    Feature("position_error", "base_axes", 0.5),
    Feature("position_error", "bearing", 0.1),
    Feature("velocity_error", "base_axes", 0.1),
    *_EPISODE,
)
DUAL_SPATIAL_FEATURES = (
    Feature("joint_position", "from_home", 0.5),
    Feature("joint_velocity", "plain", 0.2),
    Feature("base_quaternion", "rotation", 0.02),
    Feature("base_linear_velocity", "base_axes", 0.02),
    Feature("base_angular_velocity", "base_axes", 0.02),
    Feature("end_effector_position", "from_base", 0.5),
    Feature("end_effector_linear_velocity", "base_axes", 0.2),
    Feature("goal_linear_velocity", "base_axes", 0.02),
    Feature("goal_axis", "base_axes", 1.0),
    Feature("position_error", "base_axes", 0.3),
    Feature("position_error", "bearing", 0.1),
    Feature("axis_error", "base_axes", 0.3),
    Feature("axis_error", "bearing", 0.1),
    Feature("velocity_error", "base_axes", 0.1),
    *_EPISODE,
)

# Kinds and scales for fields of the names that the tasks here use. Any other field is plain, of scale 1.
_USUAL: dict[str, tuple[tuple[str, float], ...]] = {
    "joint_position": (("from_home", 0.5),),
    "joint_velocity": (("plain", 0.2),),
    "base_quaternion": (("rotation", 0.1),),
    "base_angle": (("plain", 0.1),),
    "base_linear_velocity": (("base_axes", 0.05),),
    "base_angular_velocity": (("base_axes", 0.05),),
    "end_effector_position": (("from_base", 1.0),),
    "end_effector_linear_velocity": (("base_axes", 0.2),),
    "end_effector_angular_velocity": (("base_axes", 0.2),),
    "end_effector_axis": (("base_axes", 1.0),),
    "target_position": (("from_base", 1.0),),
    "target_angular_velocity": (("base_axes", 0.1),),
    "goal_position": (("from_base", 1.0),),
    "goal_linear_velocity": (("base_axes", 0.05),),
    "goal_axis": (("base_axes", 1.0),),
    "position_error": (("base_axes", 0.5), ("bearing", 0.1)),
    "rotation_error": (("base_axes", 0.5), ("bearing", 0.2)),
    "axis_error": (("base_axes", 0.5), ("bearing", 0.2)),
    "velocity_error": (("base_axes", 0.1),),
    "obstacle_position": (("from_base", 1.0),),
    "obstacle_radius": (("plain", 0.3),),
    "peak_attitude": (("plain", 0.02),),
    "time": (("plain", 20.0),),
}


def usual_features(layout: ObservationLayout) -> tuple[Feature, ...]:
    """Features of every field of a layout, by its name; plain where the name or its frame is not known."""
    table: list[Feature] = []
    for field in layout.fields:
        for kind, scale in _USUAL.get(field.name, (("plain", 1.0),)):
            if kind in IN_BASE_AXES and not has_base_axes(layout, field.name, kind):
                table.append(Feature(field.name, "plain", scale))
                break
            table.append(Feature(field.name, kind, scale))
    return tuple(table)
