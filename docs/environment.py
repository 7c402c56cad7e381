"""The page of a registered id, written from its task, its model and the environment's own docstrings."""

import inspect
import sys
from dataclasses import fields
from typing import Any

import numpy as np

from docs.reading import comments, described, flowed, number, section, split_unit, summary, table
from space_envs.control import CONTROL_MODES, MODES
from space_envs.envs import OUTCOMES, CaptureVectorEnv
from space_envs.models.single_arm import ModelOptions
from space_envs.registration import ENTRIES, ENVELOPE_KEYWORDS
from space_envs.reset_options import RESET_OPTIONS
from space_envs.tasks.common import DIFFICULTIES, REWARDS, SPLITS

OUTCOME_TEXT = {
    "running": ("", "The episode goes on."),
    "captured": ("`terminated`", "The capture conditions have held for the hold time."),
    "timeout": ("`truncated`", "The horizon was reached."),
    "attitude_lost": (
        "`terminated`",
        "The satellite has turned by more than `attitude_limit` from its attitude at the start.",
    ),
    "diverged": (
        "`terminated`",
        "The simulation left the finite numbers; the observation is the last sound one.",
    ),
}
SPLIT_TEXT = {
    "train": "training and demonstrations",
    "validation": "held out, to choose among policies while they learn",
    "test": "the leaderboard",
    "ood": "out of distribution: goals farther from home, and satellites of other masses",
}
INFO_TEXT = {
    "split": "`reset`: the split that the goal is from, or `given` where the options set the goal",
    "index": "`reset`: the goal's number in its split, or -1",
    "reward_terms": "`step`: every term of the reward by name; their sum is the reward",
    "attitude": "`step`: angle of the satellite from its attitude at the start, deg",
    "is_success": "`step`: whether the episode ended in a capture",
    "outcome": "`step`: one of the outcomes above",
    "clipped_actions": "`step`: steps of the episode so far whose action lay outside [-1, 1]",
}
ONLY_VECTOR = ("num_envs", "autoreset_mode")


def environment_page(env_id: str) -> str:
    """The whole page as Markdown.

    Raises:
        RuntimeError: if the code knows an outcome, a split or an info key that this module does not.
    """
    env = CaptureVectorEnv(env_id=env_id)
    _, begun = env.reset(seed=0)
    *_, info = env.step(np.zeros(env.action_space.shape))
    keys = {key for key in {**begun, **info} if not key.startswith("_")}
    for ours, theirs in ((OUTCOME_TEXT, OUTCOMES), (SPLIT_TEXT, SPLITS), (INFO_TEXT, keys)):
        if set(ours) != set(theirs):
            raise RuntimeError(f"docs/environment.py describes {sorted(ours)}, the code has {sorted(theirs)}")
    parts = [
        f"<!-- Written by `python -m docs.generate` from the code; do not edit. -->\n\n# {env_id}",
        _opening(env),
        _robot(env),
        _actions(env),
        _observations(env),
        _rewards(env),
        _capture(env),
        _goals(env),
        _keywords(env),
        _reset(),
        _info(),
        _versions(env_id),
    ]
    return "\n\n".join(parts) + "\n"


def _module(env: CaptureVectorEnv) -> Any:
    return sys.modules[type(env.task).__module__]


def _sentence(text: str) -> str:
    return text[:1].upper() + text[1:].rstrip(".") + "."


def _span(ends: tuple[float, float]) -> str:
    return " to ".join(number(end) for end in ends)


def _opening(env: CaptureVectorEnv) -> str:
    # The module's first paragraph is its title; ENTRIES has the same in a line that stands alone.
    _, *rest = flowed(inspect.getdoc(_module(env)) or "").split("\n\n")
    example = f"""```python
import gymnasium as gym

import space_envs

env = gym.make("{env.env_id}")
observation, info = env.reset(seed=0)
observation, reward, terminated, truncated, info = env.step(env.action_space.sample())
error = env.unwrapped.task.layout.read(observation, "position_error")

envs = gym.make_vec("{env.env_id}", num_envs=16, control_mode="reactionless", difficulty="hard")
observations, infos = envs.reset(seed=0)
```"""
    vector = (
        "Seed `s` gives row `i` of the vector environment the episode that seed `s + i` gives the single "
        "one, bit for bit. [Physics and symbols](../physics.md) says what is simulated."
    )
    return "\n\n".join([_sentence(ENTRIES[env.env_id].summary), *rest, example, vector])


def _robot(env: CaptureVectorEnv) -> str:
    robot, drive, task = env.task.robot, env.drive, env.task
    low, high = (robot.range - robot.home[:, None]).T
    stops = ", ".join(sorted({f"{a:+.3g} to {b:+.3g}" for a, b in zip(low, high, strict=True)}))
    torque = number(sorted({float(limit) for limit in drive.torque_limit}))
    rows = [
        ("bodies", f"satellite {robot.mass[0]:g} kg, {robot.n_joints} links {robot.mass[1:].sum():g} kg"),
        ("base", "free; nothing acts on it, gravity is zero"),
        ("home, rad", number(np.round(robot.home, 6).tolist())),
        ("joint range, rad from home", stops),
        ("rate limit, rad/s", number(drive.rate_limit)),
        ("acceleration limit, rad/s^2", number(drive.acceleration_limit)),
        ("torque limit, N m", torque),
        ("reach from the centre of mass, m", f"{robot.reach():.2f}"),
        ("control period, s", number(task.control_period)),
        ("simulation step, s", f"{number(task.step_size)}, fourth-order Runge-Kutta"),
        ("cameras", ", ".join(f"`{task.render_model.cam(i).name}`" for i in range(task.render_model.ncam))),
    ]
    variants = described(section(ModelOptions.__doc__, "Attributes"), ("variant", "timestep", "visual"))
    return "\n\n".join(
        [
            "## Robot",
            "An episode starts at `home` with the satellite at the inertial origin and everything at rest, "
            "so that total momentum is zero and stays so. Limits are those of the drives, in every control "
            "mode.",
            table(("", "value"), rows),
            f"Keyword `variant`: {variants['variant']}",
        ]
    )


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
            "Every mode ends in joint torques, held over the control period.",
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
    tasks = {reward: type(env.task)(reward=reward) for reward in REWARDS}
    kind = type(env.task.weights)
    said = comments(kind)
    rows = []
    for field in fields(kind):
        weights = [getattr(task.weights, field.name) for task in tasks.values()]
        rows.append((f"`{field.name}`", *[number(w) if w else "" for w in weights], said[field.name]))
    header = ["term", *[f"`{reward}`" for reward in REWARDS], "what is weighted"]
    goal = (
        "`space_envs.wrappers.GoalConditioned` wraps the single environment for hindsight experience replay."
    )
    return "\n\n".join(
        [
            "## Reward",
            "The reward is the sum of named terms, with weights by keyword `reward`.",
            flowed(section(kind.__doc__, "").partition("\n\n")[2]),
            table(header, rows),
            goal,
        ]
    )


def _capture(env: CaptureVectorEnv) -> str:
    envelope = env.task.envelope
    said, keyword = comments(type(envelope)), {field: name for name, field in ENVELOPE_KEYWORDS.items()}
    limits = [
        (name.replace("_", " "), number(value), said[name], f"`{keyword[name]}`")
        for name, value in vars(envelope).items()
        if name in said
    ]
    ends = [(f"`{name}`", *OUTCOME_TEXT[name]) for name in OUTCOMES]
    return "\n\n".join(
        [
            "## Capture and end of an episode",
            f"{summary(type(envelope))} The reward has no part in this.",
            table(("of end-effector to grapple", "at most", "unit", "keyword"), limits[:-1]),
            f"Hold time: {limits[-1][1]} {limits[-1][2]} (keyword {limits[-1][3]}), in consecutive steps.",
            table(('`info["outcome"]`', "flag", "when"), ends),
        ]
    )


def _goals(env: CaptureVectorEnv) -> str:
    task, module = env.task, _module(env)
    said = comments(module)
    rows = [
        (f"`{split}`", str(task.split_size(split)), str(module.SPLIT_SEED[split]), SPLIT_TEXT[split])
        for split in SPLITS
    ]
    start = task.robot.end_effector_pose(task.robot.home)[0]
    distances = []
    for difficulty in DIFFICULTIES:
        cells = [f"`{difficulty}`", number(module.RADIUS[difficulty])]
        for split in ("test", "ood"):
            chosen = type(task)(difficulty=difficulty, split=split)
            position = chosen.goals(split, np.arange(chosen.split_size(split))).position
            way = np.linalg.norm(position - start, axis=-1)
            cells.append(f"{way.min():.2f}, {np.median(way):.2f}, {way.max():.2f}")
        distances.append(cells)
    return "\n\n".join(
        [
            "## Splits and difficulties",
            "Goals are drawn from fixed seeds, so that a goal's index names it for ever. Without options, "
            "`reset` draws an index of the environment's split from the environment's generator.",
            table(("split", "goals", "seed", "for"), rows),
            f"Out of distribution, the largest joint displacement is {_span(module.OOD_RADIUS)} of the "
            f"radius, and the satellite's mass and inertia are {_span(module.OOD_MASS)} of the nominal ones. "
            "Policies are given the nominal model all the same.",
            "Distances are those of the goals from where the end-effector starts: least, median, largest. "
            f"Radius: {said['RADIUS'][0].lower()}{said['RADIUS'][1:]}",
            table(("difficulty", "radius", "test, m", "ood, m"), distances),
        ]
    )


def _keywords(env: CaptureVectorEnv) -> str:
    signature = inspect.signature(CaptureVectorEnv)
    own = {n: p.default for n, p in signature.parameters.items() if n not in ("env_id", "keywords")}
    about = described(section(CaptureVectorEnv.__doc__, "Args"), [*signature.parameters, "**keywords"])
    kind = type(env.task)
    names = [field.name for field in fields(kind)]
    about |= described(section(kind.__doc__, "Attributes"), names)
    units = comments(type(env.task.envelope))
    rows = []
    for name, default in own.items():
        vector = "; `gym.make_vec` only" if name in ONLY_VECTOR else ""
        rows.append((f"`{name}`", f"`{default!r}`", about[name].rstrip(".") + vector))
    for name in names:
        if name != "envelope":
            meaning = about[name].rstrip(".").replace("docs/momentum.md", "[momentum](../momentum.md)")
            rows.append((f"`{name}`", f"`{getattr(env.task, name)!r}`", meaning))
    for name, field in ENVELOPE_KEYWORDS.items():
        value = getattr(env.task.envelope, field)
        rows.append((f"`{name}`", f"`{value!r}`", f"of a capture, {units[field]}"))
    return "\n\n".join(
        [
            "## Keywords",
            "Of `gym.make` and `gym.make_vec`. A name or value that is not valid is a `ConfigurationError` "
            "that says which are, and which is nearest.",
            table(("keyword", "default", "meaning"), rows),
        ]
    )


def _reset() -> str:
    args = section(CaptureVectorEnv.reset.__doc__, "Args")
    about = described(args, ("seed", "options"))
    names = ", ".join(f"`{name}`" for name in RESET_OPTIONS)
    return "\n\n".join(
        [
            "## Reset",
            "`reset(seed=..., options={...})`",
            f"- `seed`: {about['seed']}\n- `options`: {about['options']}",
            f"Options: {names}. `reset_mask` is for the vector environment.",
        ]
    )


def _info() -> str:
    rows = [(f"`{key}`", text) for key, text in INFO_TEXT.items()]
    return "\n\n".join(
        [
            "## Info",
            table(("key", "meaning"), rows),
            "The vector environment's infos hold an array for each key, and with a leading underscore the "
            "mask of rows that have it. In autoreset mode `same_step`, rows that ended have their last "
            "observation in `final_obs` and their last info in `final_info`.",
        ]
    )


def _versions(env_id: str) -> str:
    version = env_id.rpartition("-")[2]
    return f"## Versions\n\n- {version}: the first."
