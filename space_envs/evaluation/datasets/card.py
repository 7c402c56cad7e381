"""Dataset cards: what made a dataset and what is in it, as JSON and as Markdown."""

from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from space_envs.envs import CaptureVectorEnv
from space_envs.errors import ConfigurationError
from space_envs.evaluation.datasets.recording import OmittedEpisode
from space_envs.evaluation.datasets.storage import SCHEMA_VERSION, Dataset
from space_envs.evaluation.records.configuration import configuration, configuration_hash
from space_envs.system.digests import file_digest
from space_envs.system.files import atomic_write_text, write_json
from space_envs.system.reading import read_object

EPISODES, CARD, README = "episodes.npz", "dataset.json", "README.md"
REPLAY = (
    "Each episode was played again from its seed, goal and actions, alone, in another environment; every bit "
    "of its observations, rewards, terminations and truncations, and its outcome, came out again. "
    "Episodes that did not are omitted."
)
_ACTION_UNITS = {
    "joint_velocity": "joint rates, rad/s",
    "joint_torque": "joint torques, N m",
    "end_effector_velocity": "end-effector twists, m/s and rad/s",
    "reactionless": "joint rates before they are made reactionless, rad/s",
}


def make_card(
    request: Mapping[str, Any],
    provenance: Mapping[str, Any],
    dataset: Dataset,
    omitted: Sequence[OmittedEpisode],
    env: CaptureVectorEnv,
) -> dict[str, Any]:
    """Card of a dataset as plain JSON values: what made it and what it holds.

    Args:
        request: what was asked for, plain values. provenance: command, versions, commit.
        dataset: what is written. omitted: episodes that are not, other than for not being captures.
        env: that it was made in.
    """
    task, outcomes = env.task, Counter(dataset.outcome.tolist())
    config = configuration(env.env_id, env.control_mode, task)
    return {
        "schema": SCHEMA_VERSION,
        "id": request["id"],
        "request": dict(request),
        "provenance": dict(provenance),
        "episodes": {
            "asked": request["episodes"],
            "written": len(dataset),
            "steps": int(dataset.lengths.sum()),
            "captured": int(dataset.captured.sum()),
            "outcomes": {name: outcomes[name] for name in sorted(outcomes)},
            "not_captured": request["episodes"] - len(dataset) - len(omitted),
            "omitted": [vars(one) for one in omitted],
        },
        "goal_indices": dataset.index.tolist(),
        "observation": [
            {
                "name": field.name,
                "start": env.task.layout.slices[field.name].start,
                "stop": env.task.layout.slices[field.name].stop,
                "bound": field.bound,
                "meaning": field.meaning,
            }
            for field in env.task.layout.fields
        ],
        "action": {
            "control_mode": env.control_mode,
            "low": -1.0,
            "high": 1.0,
            "meaning": _ACTION_UNITS[env.control_mode],
            "scale": env.mode.scale.tolist(),
        },
        "configuration": config,
        "configuration_hash": configuration_hash(config),
        "replay": REPLAY,
    }


def write_card(folder: Path, card: Mapping[str, Any]) -> None:
    """Write both forms of a card. The JSON comes last: a folder that has it is complete."""
    atomic_write_text(folder / README, to_markdown(card))
    write_json(folder / CARD, card)


def read_card(folder: Path) -> dict[str, Any] | None:
    """The card of a folder, once its files were found to be those that were written; None if it has none.

    Raises:
        ConfigurationError: if the card cannot be read, or a file is not the one that was written.
    """
    path = folder / CARD
    if not path.exists():
        return None
    try:
        card = read_object(path)
        files = dict(card["files"])
        schema, _ = card["schema"], dict(card["request"])
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise ConfigurationError(f"{path} is no card of a dataset: {error!r}") from None
    if schema != SCHEMA_VERSION:
        raise ConfigurationError(f"{path} has schema {schema}, this version reads {SCHEMA_VERSION}")
    for name, wanted in files.items():
        if not (folder / name).is_file():
            raise ConfigurationError(f"{folder / name} is missing, which {CARD} names; remove the folder")
        if file_digest(folder / name) != wanted:
            raise ConfigurationError(
                f"{folder / name} is not the file that was written: its checksum is not that in {CARD}; "
                "remove the folder to make it again"
            )
    return card


def to_markdown(card: Mapping[str, Any]) -> str:
    """Markdown of a card."""
    request, counts, action = card["request"], card["episodes"], card["action"]
    provenance = card["provenance"]
    outcomes = ", ".join(f"{count} {name}" for name, count in counts["outcomes"].items())
    lines = [
        f"# {card['id']}",
        "",
        f"Episodes of the policy `{plain(request['policy'])}` on `{request['env_id']}`, "
        f"difficulty {request['difficulty']}, {request['split']} split, goal {request['goal']}.",
        "",
        "| | |",
        "|---|---|",
        f"| episodes | {counts['written']} of {counts['asked']} asked for, {counts['steps']} steps |",
        f"| outcomes | {outcomes} |",
        f"| omitted | {len(counts['omitted'])} lost or not reproduced, "
        f"{counts['not_captured']} not captured |",
        f"| robot | {plain(request['robot'])}, {request['robot_digest']} |",
        f"| seed | {request['seed']}, of the policy and of the order of the goals |",
        f"| control mode | {action['control_mode']}: {action['meaning']} |",
        f"| action scale | {', '.join(f'{value:.6g}' for value in action['scale'])} per unit action |",
        f"| control period | {card['configuration']['control_period']:.6g} s |",
        f"| configuration | {card['configuration_hash']} |",
        f"| commit | {provenance['commit']} |",
        f"| versions | {', '.join(f'{name} {value}' for name, value in provenance['versions'].items())} |",
        f"| machine | {plain(provenance['machine'])} |",
    ]
    lines += [f"| `{name}` | SHA-256 {value} |" for name, value in card["files"].items()]
    if "minari" in card:
        lines.append(f"| Minari | `{card['minari']['dataset_id']}` |")
    lines += ["", "## Made by", "", "```sh", provenance["command"], "```", "", card["replay"], ""]
    lines += ["## Observation", "", "| columns | name | bound | meaning |", "|---|---|---|---|"]
    for field in card["observation"]:
        columns = f"{field['start']}:{field['stop']}"
        lines.append(f"| {columns} | {field['name']} | {field['bound']:.6g} | {field['meaning']} |")
    if counts["omitted"]:
        lines += ["", "## Left out", "", "| episode | goal | why |", "|---|---|---|"]
        for one in counts["omitted"]:
            lines.append(f"| {one['episode']} | {one['index']} | {plain(one['reason'])} |")
    goals = ", ".join(map(str, card["goal_indices"]))
    return "\n".join([*lines, "", "## Goals", "", f"Indices in the split, in order: {goals}.", ""])


def plain(text: str) -> str:
    """Text that stays within its cell of a table."""
    return " ".join(text.replace("|", "/").replace("`", "'").replace("<", "&lt;").split())
