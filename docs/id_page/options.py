"""Sections of an id's page about keywords, reset and info."""

import inspect
from dataclasses import fields

from docs.reading import (
    attributes,
    described,
    field_comments,
    number,
    section,
    table,
)
from space_envs.drives import STOP_MARGIN
from space_envs.envs import CaptureVectorEnv
from space_envs.envs.keywords import EnvOptions
from space_envs.envs.starts import COMMON_OPTIONS
from space_envs.registration import ENVELOPE_KEYWORDS

INFO_TEXT = {
    "split": "`reset`: the split that the goal is from, or `given` if the options set the goal",
    "index": "`reset`: the goal's number in its split, or -1",
    "reward_terms": "`step`: every term of the reward by name; their sum is the reward",
    "attitude": "`step`: attitude error: angle of the satellite from its initial attitude, deg",
    "is_success": "`step`: whether the episode ended in a capture",
    "outcome": "`step`: one of the outcomes above",
    "collision": "`step`: the bodies that touched, as in `link 4 and the satellite`; else empty",
    "clipped_actions": "`step`: number of steps of the episode so far whose action was outside [-1, 1]",
}


OPTION_TEXT = {
    "split": "which split the goal is from",
    "index": "number of the goal in the split",
    "joint_position": f"initial joint angles, rad; at least {STOP_MARGIN:g} rad inside their range",
    "joint_velocity": (
        "initial joint rates, rad/s, that the drives can brake before the end of the range; the "
        "satellite then moves so that momentum is zero"
    ),
    "reset_mask": "bool, the rows to reset; vector environment only",
    "goal_position": "position of the grapple pose, inertial frame, m",
    "goal_quaternion": "orientation of the grapple pose, w x y z, grapple to inertial",
    "obstacle_position": "centres of the three keep-out spheres, concatenated, inertial frame, m",
    "obstacle_radius": "radii of the keep-out spheres, m",
    "target_position": "centre of the target, inertial frame, m",
    "target_angle": "attitude of the target, rad",
    "target_quaternion": "attitude of the target, w x y z, body to inertial",
    "target_angular_velocity": "angular velocity of the target, inertial axes, rad/s",
    "target_half_width": "distance of the grapple points from the target's centre, m",
}


ONLY_VECTOR = ("num_envs", "autoreset_mode")


def keywords_section(env: CaptureVectorEnv) -> str:
    """Section on the keywords of `gym.make`."""
    signature = inspect.signature(CaptureVectorEnv)
    names = ("num_envs", "control_mode", "autoreset_mode", *(field.name for field in fields(EnvOptions)))
    own = {name: signature.parameters[name].default for name in names}
    about = described(section(CaptureVectorEnv.__doc__, "Args"), [*signature.parameters, "**keywords"])
    about |= attributes(type(env.task))
    units = field_comments(type(env.task.envelope))
    rows = []
    for name, default in own.items():
        vector = "; `gym.make_vec` only" if name in ONLY_VECTOR else ""
        rows.append((f"`{name}`", f"`{default!r}`", about[name].rstrip(".") + vector))
    for field in fields(env.task):
        if field.name != "envelope":
            meaning = about[field.name].rstrip(".").replace("docs/momentum.md", "[momentum](../momentum.md)")
            rows.append((f"`{field.name}`", f"`{field.default!r}`", meaning))
    for name, field in ENVELOPE_KEYWORDS.items():
        if field in units:
            rows.append(
                (
                    f"`{name}`",
                    f"`{getattr(env.task.envelope, field)!r}`",
                    f"tolerance of a capture, {units[field]}",
                )
            )
    return "\n\n".join(
        [
            "## Keywords",
            "Of `gym.make` and `gym.make_vec`. An invalid name or value is a `ConfigurationError` "
            "that lists the valid ones and the nearest.",
            table(("keyword", "default", "meaning"), rows),
        ]
    )


def reset_section(env: CaptureVectorEnv) -> str:
    """Section on the options of `reset`."""
    args = section(CaptureVectorEnv.reset.__doc__, "Args")
    about = described(args, ("seed", "options"))
    joints = f"({env.task.mechanics.n_joints},)"
    widths = {"joint_position": joints, "joint_velocity": joints, "reset_mask": "(N,)"}
    rows = [(f"`{name}`", widths.get(name, ""), OPTION_TEXT[name]) for name in COMMON_OPTIONS]
    for name, option in env.task.goal_options.items():
        default = "" if option.default is None else f"; {number(option.default)} by default"
        default += f"; each at most {number(option.largest)} in absolute value"
        rows.append((f"`{name}`", f"({option.width},)", f"goal: {OPTION_TEXT[name]}{default}"))
    return "\n\n".join(
        [
            "## Reset",
            "`reset(seed=..., options={...})`",
            f"`seed`: {about['seed']}",
            "`options` are values for all rows or, with a leading axis, one per row. Give either a split and "
            "an index, or a goal; a goal that is malformed or out of reach is a `GoalError`.",
            table(("option", "shape", "meaning"), rows),
        ]
    )


def info_section() -> str:
    """Section on `info`."""
    rows = [(f"`{key}`", text) for key, text in INFO_TEXT.items()]
    return "\n\n".join(
        [
            "## Info",
            table(("key", "meaning"), rows),
            "The vector environment's infos hold an array for each key, and under the key with a leading "
            "underscore the mask of rows that have it. In autoreset mode `same_step`, rows that ended have "
            "their last observation in `final_obs` and their last info in `final_info`.",
        ]
    )
