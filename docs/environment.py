"""The page of a registered id, written from its task, its model and the environment's own docstrings."""

import inspect
import sys
from dataclasses import fields

import numpy as np

from docs.goals import SPLIT_TEXT, goals
from docs.reading import (
    attributes,
    described,
    field_comments,
    flowed,
    number,
    section,
    split_unit,
    summary,
    table,
)
from docs.robots import parameters
from space_envs.control import CONTROL_MODES, MODES
from space_envs.drives import STOP_MARGIN
from space_envs.dynamics.rotations import Array
from space_envs.envs import CaptureVectorEnv
from space_envs.envs.keywords import EnvOptions
from space_envs.envs.starts import COMMON_OPTIONS
from space_envs.registration import ENTRIES, ENVELOPE_KEYWORDS
from space_envs.robots.parameters import LEAST_TIMESTEP
from space_envs.robots.single_arm import ModelOptions
from space_envs.tasks.base import CaptureTask
from space_envs.tasks.common import REWARDS, SPLITS, CaptureEnvelope
from space_envs.tasks.dual_arm import DualArmTask
from space_envs.tasks.outcome import ENV_OUTCOMES, Outcome

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
COUNTED_TEXT = {"second": "per s", "once": "once"}
ONLY_VECTOR = ("num_envs", "autoreset_mode")


def environment_page(env_id: str) -> str:
    """The whole page as Markdown.

    Raises:
        RuntimeError: if the code knows a split, an info key or a reset option that is not
            described.
    """
    env = CaptureVectorEnv(env_id=env_id)
    _, begun = env.reset(seed=0)
    *_, info = env.step(np.zeros(env.action_space.shape))
    keys = {key for key in {**begun, **info} if not key.startswith("_")}
    options = {*OPTION_TEXT} & {*COMMON_OPTIONS, *env.task.goal_options}
    for ours, theirs in (
        (SPLIT_TEXT, SPLITS),
        (INFO_TEXT, keys),
        (options, (*COMMON_OPTIONS, *env.task.goal_options)),
    ):
        if set(ours) != set(theirs):
            raise RuntimeError(f"the documentation describes {sorted(ours)}, the code has {sorted(theirs)}")
    parts = [
        f"<!-- Written by `python -m docs.generate` from the code; do not edit. -->\n\n# {env_id}",
        _opening(env),
        _robot(env),
        _actions(env),
        _observations(env),
        _rewards(env),
        _capture(env),
        goals(env.task),
        _keywords(env),
        _reset(env),
        _info(),
        _versions(env),
    ]
    return "\n\n".join(parts) + "\n"


def _sentence(text: str) -> str:
    return text[:1].upper() + text[1:].rstrip(".") + "."


def _opening(env: CaptureVectorEnv) -> str:
    # The module's first paragraph is its title; the task's summary says the same in a line that stands alone.
    rest = next(text for kind in type(env.task).__mro__ if (text := _rest_of_docstring(kind)))
    example = f"""```python
import gymnasium as gym

import space_envs

env = gym.make("{env.env_id}")
observation, info = env.reset(seed=0)
observation, reward, terminated, truncated, info = env.step(env.action_space.sample())
error = env.unwrapped.task.layout.read(observation, "position_error")

keywords = {{"control_mode": "reactionless", "difficulty": "hard"}}
envs = gym.make_vec("{env.env_id}", num_envs=16, **keywords)
observations, infos = envs.reset(seed=0)
```"""
    vector = (
        "Seed `s` gives row `i` of the vector environment the episode that seed `s + i` gives the single "
        "one, bit for bit. [Physics and symbols](../physics.md) describes the simulation."
    )
    return "\n\n".join([_sentence(ENTRIES[env.env_id].summary), rest, example, vector])


def _rest_of_docstring(kind: type) -> str:
    """Docstring of a class's module without its first paragraph."""
    return flowed(inspect.getdoc(sys.modules[kind.__module__]) or "").partition("\n\n")[2]


def _steps(task: CaptureTask) -> str:
    return f"{LEAST_TIMESTEP:g} to {task.largest_timestep:g}"


def _robot(env: CaptureVectorEnv) -> str:
    robot, drive, task = env.task.robot, env.drive, env.task
    torque = number(sorted({float(limit) for limit in drive.torque_limit}))
    free = "two slides and a hinge" if env.simulation.planar else "six degrees of freedom"
    rows = [
        ("bodies", f"satellite {robot.mass[0]:g} kg, {robot.n_joints} links {robot.mass[1:].sum():g} kg"),
        ("base", f"{free}; not actuated, gravity is zero"),
        ("home, rad", number(np.round(robot.home, 6).tolist())),
        ("joint range, rad", _ranges(robot.range, robot.home)),
        ("rate limit, rad/s", number(drive.rate_limit)),
        ("acceleration limit, rad/s^2", number(drive.acceleration_limit)),
        ("torque limit, N m", torque),
        (
            "reach from the centre of mass, m",
            ", ".join(f"{robot.reach(arm):.2f}" for arm in range(len(robot.end_effector_link))),
        ),
        ("control period, s", f"{number(task.control_period)}; at most {task.largest_control_period:g}"),
        ("simulation step, s", f"{number(task.step_size)}, fourth-order Runge-Kutta; {_steps(task)}"),
        ("cameras", ", ".join(f"`{task.render_model.cam(i).name}`" for i in range(task.render_model.ncam))),
    ]
    variant = []
    if "variant" in {field.name for field in fields(task)}:
        meaning = described(section(ModelOptions.__doc__, "Attributes"), ("variant", "timestep", "visual"))
        variant = [f"Keyword `variant`: {meaning['variant']}"]
    return "\n\n".join(
        [
            "## Robot",
            "An episode starts with the satellite at the inertial origin and the whole robot at rest, so "
            "that its total momentum is zero and remains zero. The joints are at `home`, or near it where "
            "the goal includes initial joint angles. Limits are those of the drives, in every mode.",
            table(("", "value"), rows),
            *variant,
            f"{summary(type(task.parameters))} Its links are listed in [physics](../physics.md#the-models).",
            parameters(task.parameters),
        ]
    )


def _ranges(limits: Array, home: Array) -> str:
    """Joint ranges (n, 2) as text, equal ones once."""
    around = {f"{a:+.3g} to {b:+.3g}" for a, b in limits - home[:, None]}
    absolute = [f"{a:+.3g} to {b:+.3g}" for a, b in limits]
    if len(around) == 1:
        return f"{around.pop()} from home"
    joints: dict[str, list[str]] = {}
    for number_, text in enumerate(absolute, start=1):
        joints.setdefault(text, []).append(str(number_))
    if len(joints) == 1:
        return absolute[0]
    return "; ".join(f"{text} (joints {', '.join(which)})" for text, which in joints.items())


def _actions(env: CaptureVectorEnv) -> str:
    rows = []
    for mode in CONTROL_MODES:
        built = MODES[mode](env.drive)
        scale = [float(each) for each in built.scale]
        shown = f"{number(scale[0])} each" if len(set(scale)) == 1 else number(scale)
        name = f"`{mode}`" + (" (default)" if mode == env.control_mode else "")
        rows.append((name, str(built.size), shown, " ".join((inspect.getdoc(MODES[mode]) or "").split())))
    return "\n\n".join(
        [
            "## Actions",
            f"`Box(-1, 1, (m,), {env.single_action_space.dtype})`. Actions outside the box are clipped and "
            "counted in `info`; a wrong shape, NaN or infinity is an `ActionError` before anything moves. "
            "Every mode results in joint torques, held over the control period.",
            table(("control mode", "m", "physical units per unit action", "meaning"), rows),
        ]
    )


def _observations(env: CaptureVectorEnv) -> str:
    layout, rows = env.task.layout, []
    for field in layout.fields:
        place, (unit, meaning) = layout.slices[field.name], split_unit(field.meaning)
        index = str(place.start) if field.size == 1 else f"{place.start}:{place.stop}"
        rows.append((index, f"`{field.name}`", unit, meaning, number(field.bound)))
    return "\n\n".join(
        [
            "## Observations",
            f"`Box` of shape `({layout.size},)`, `{env.single_observation_space.dtype}`. Quaternions are "
            "(w, x, y, z). `env.unwrapped.task.layout.read(observation, name)` is a view of a field, for one "
            "observation or a batch of them.",
            table(("index", "name", "unit", "meaning", "bound"), rows),
        ]
    )


def _rewards(env: CaptureVectorEnv) -> str:
    task = env.task
    tables = [{term.name: term for term in terms} for terms in (task.dense_reward, task.sparse_reward)]
    rows = []
    for name in dict.fromkeys(name for terms in tables for name in terms):
        term = next(terms[name] for terms in tables if name in terms)
        weights = [number(terms[name].weight) if name in terms else "" for terms in tables]
        rows.append((f"`{name}`", *weights, COUNTED_TEXT[term.per], summary(term.function)))
    header = ["term", *[f"`{reward}`" for reward in REWARDS], "counted", "weighted quantity"]
    goal = (
        "`space_envs.wrappers.GoalConditioned` wraps the single environment for hindsight experience replay."
    )
    return "\n\n".join(
        [
            "## Reward",
            "The reward is the sum of named terms; the keyword `reward` selects their weights.",
            "The sum of `attitude` over an episode is minus the base disturbance (eq. 20 of shyam2020) times "
            "dt. Terms per second are multiplied by the control period.",
            *(
                ["Errors are those of the arm with the larger error."]
                if len(env.task.robot.end_effector_link) > 1
                else []
            ),
            table(header, rows),
            goal,
        ]
    )


def _capture(env: CaptureVectorEnv) -> str:
    envelope = env.task.envelope
    units = field_comments(type(envelope))
    limits = [
        (name.replace("_", " "), number(getattr(envelope, name)), units[name], f"`{keyword}`")
        for keyword, name in ENVELOPE_KEYWORDS.items()
        if name in units
    ]
    both = "Each end-effector has to be at its own grapple point, both at once; the tolerances apply to "
    ends = [
        (f"`{outcome}`", outcome.flag and f"`{outcome.flag}`", outcome.meaning)
        for outcome in ENV_OUTCOMES
        if outcome is not Outcome.COLLISION or env.task.collides
    ]
    return "\n\n".join(
        [
            "## Capture and end of an episode",
            f"{summary(CaptureEnvelope)} This does not depend on the reward.",
            *([f"{both}the worse of the two."] if len(env.task.robot.end_effector_link) > 1 else []),
            table(("error of the end-effector", "tolerance", "unit", "keyword"), limits[:-1]),
            f"Hold time: {limits[-1][1]} {limits[-1][2]} (keyword {limits[-1][3]}), in consecutive steps.",
            table(('`info["outcome"]`', "flag", "when"), ends),
            *([_contacts(env)] if env.task.collides else []),
        ]
    )


def _contacts(env: CaptureVectorEnv) -> str:
    """Bodies that a link may not touch, and the geometry of the links."""
    shape = env.task.contacts.shape
    bodies = [] if shape.half is None else [f"the satellite, a cube of side {number(2.0 * shape.half)} m"]
    target = env.task.target if isinstance(env.task, DualArmTask) else None
    if target is not None:
        sides = " x ".join(number(2.0 * side) for side in target.body)
        bodies.append(f"the target, a box of {sides} m at half width {number(target.half_width)} m")
    bodies += ["the other arm"] if env.task.contacts.arms == 2 else []
    bodies += ["the keep-out spheres"] if "obstacle_radius" in env.task.layout.slices else []
    sentences = [
        f"Links are capsules of radius {number(shape.radius)} m from joint to joint. There are no contact "
        f"forces; a link that touches {', or '.join(bodies)}, ends the episode as a collision, by distance. "
        "Distances are evaluated nine times per control period, with linear interpolation. An arm may pass "
        "through itself."
    ]
    if shape.half is None:
        sentences.append("The arms move in a plane above the satellite's deck, so that they cannot touch it.")
    elif shape.satellite[0] == 0.0:
        sentences.append(
            f"Link {shape.link[0]}, which rotates on the satellite's deck, is checked against it by its "
            "centre line only, from where it leaves the deck."
        )
    if target is not None:
        sentences.append(
            f"The outer {number(target.gripper)} m of an arm are the gripper, of which only the centre "
            "line is checked against the target."
        )
    else:
        sentences.append("The goal is a pose and not a body: the object drawn there has no collisions.")
    return " ".join(sentences)


def _keywords(env: CaptureVectorEnv) -> str:
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


def _reset(env: CaptureVectorEnv) -> str:
    args = section(CaptureVectorEnv.reset.__doc__, "Args")
    about = described(args, ("seed", "options"))
    joints = f"({env.task.robot.n_joints},)"
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


def _info() -> str:
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


def _versions(env: CaptureVectorEnv) -> str:
    version = env.env_id.rpartition("-")[2]
    return (
        f"## Versions\n\n- {version}: the first. Until its release, every change that alters a score raises "
        "the task version in the [records](../records.md), which `evaluate.py compare` refuses to mix. "
        f"The task version is {env.task.version}."
    )
