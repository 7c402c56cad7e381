"""Sections of an id's page about observations, reward and the end of an episode."""

from dataclasses import fields

from docs.reading import (
    field_comments,
    number,
    split_unit,
    summary,
    table,
)
from space_envs.envs import CaptureVectorEnv
from space_envs.registration import ENVELOPE_KEYWORDS
from space_envs.tasks.common import REWARDS, CaptureEnvelope
from space_envs.tasks.dual_arm import DualArmTask
from space_envs.tasks.outcome import ENV_OUTCOMES, Outcome

_GOAL_KINDS = (
    "With the keyword `goal`, a capture asks for less than the pose. The orientation error is then the angle "
    "between the approach axes (`axis`) or zero (`position`), in the reward, the observation's "
    "`rotation_error` and the records too; `goal_quaternion` is that of the pose that the goal was drawn as. "
    "The observation keeps its size, so that trained agents can be loaded."
)
COUNTED_TEXT = {"second": "per s", "once": "once", "change": "its change"}


def observations_section(env: CaptureVectorEnv) -> str:
    """Section on the observations."""
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


def rewards_section(env: CaptureVectorEnv) -> str:
    """Section on the reward terms."""
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
            "dt. Terms per second are multiplied by the control period. A term that counts a change is the "
            "change of a potential, with discount 1: its sum over an episode depends on the first and the "
            "last state alone, so that haste is not rewarded. At a capture the potential is 0; at any other "
            "end it is that of the last state. The term `capture` is ten times the score of the leaderboard, "
            "so that [the return ranks policies as the leaderboard does](../evaluating.md#returns).",
            *(
                ["Errors are those of the arm with the larger error."]
                if len(env.task.mechanics.end_effector_link) > 1
                else []
            ),
            table(header, rows),
            goal,
        ]
    )


def capture_section(env: CaptureVectorEnv) -> str:
    """Section on the capture envelope and the end of an episode."""
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
            *([f"{both}the worse of the two."] if len(env.task.mechanics.end_effector_link) > 1 else []),
            table(("error of the end-effector", "tolerance", "unit", "keyword"), limits[:-1]),
            f"Hold time: {limits[-1][1]} {limits[-1][2]} (keyword {limits[-1][3]}), in consecutive steps.",
            *([_GOAL_KINDS] if "goal" in {field.name for field in fields(env.task)} else []),
            table(('`info["outcome"]`', "flag", "when"), ends),
            *([_contacts(env)] if env.task.collides else []),
        ]
    )


def _contacts(env: CaptureVectorEnv) -> str:
    """Bodies that a link may not touch, and the geometry of the links."""
    robot, contacts = env.task.robot, env.task.contacts
    sides = " x ".join(number(2.0 * side) for side in robot.satellite.box)
    bodies = [f"the satellite, a box of {sides} m"] if robot.satellite.reachable else []
    target = env.task.target if isinstance(env.task, DualArmTask) else None
    if target is not None:
        sides = " x ".join(number(2.0 * side) for side in target.body)
        bodies.append(f"the target, a box of {sides} m at half width {number(target.half_width)} m")
    bodies += ["the other arm"] if contacts.arms == 2 else []
    bodies += ["the keep-out spheres"] if "obstacle_radius" in env.task.layout.slices else []
    radius = number(sorted(set(contacts.near_others.radius.tolist())))
    sentences = [
        f"Links are capsules of radius {radius} m from joint to joint. There are no contact forces;"
        f" a link that touches {', or '.join(bodies)}, ends the episode as a collision, by distance. "
        "Distances are evaluated nine times per control period, with linear interpolation. An arm may pass "
        "through itself."
    ]
    if not robot.satellite.reachable:
        sentences.append("The arms move in a plane above the satellite's deck, so that they cannot touch it.")
    elif contacts.near_satellite.satellite[0] == 0.0:
        sentences.append(
            f"Link {contacts.near_satellite.link[0]}, which rotates on the satellite's deck, is checked "
            "against it by its centre line only, from where it leaves the deck."
        )
    if target is not None:
        sentences.append(
            f"The outer {number(target.gripper)} m of an arm are the gripper, of which only the centre "
            "line is checked against the target."
        )
    else:
        sentences.append("The goal is a pose and not a body: the object drawn there has no collisions.")
    return " ".join(sentences)
