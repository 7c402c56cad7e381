"""Success and kept-attitude score of policies with robots that differ from the model that the policies know.

They are played by evaluate.py, in a folder that is resumed, so that the command can be stopped and started
again.
"""

import sys
from collections import defaultdict
from pathlib import Path

import numpy as np

from agents.commands.evaluate import main as evaluate
from benchmarks.arguments import whole
from benchmarks.machine import machine_class, markdown_table
from space_envs.evaluation.records.episode import EpisodeRecord
from space_envs.evaluation.records.storage import read_records
from space_envs.perturbations.amounts import PRESETS
from space_envs.system.command_line import Parser, exit_status
from space_envs.tasks.outcome import kept_attitude

Cells = dict[tuple[str, str], list[EpisodeRecord]]  # by policy and perturbation


def grouped(records: list[EpisodeRecord]) -> dict[str, Cells]:
    """Records of each policy and perturbation, by id."""
    made: dict[str, Cells] = defaultdict(lambda: defaultdict(list))
    for record in records:
        made[record.env_id][record.policy, record.perturbation].append(record)
    return made


def score(records: list[EpisodeRecord]) -> float:
    """Mean kept-attitude score of episodes."""
    peaks = [record.metrics["peak_attitude"] for record in records]
    peak = np.array([np.nan if value is None else value for value in peaks], dtype=float)
    return float(kept_attitude(np.array([record.captured for record in records]), peak).mean())


def rows(cells: Cells) -> list[list[str]]:
    """Table of an id: score and share captured of each policy with each preset, best in the last first."""
    policies = {policy for policy, _ in cells}
    hardest = list(PRESETS)[-1]
    made = []
    for policy in sorted(policies, key=lambda name: (-score(cells[name, hardest]), name)):
        of = [cells[policy, preset] for preset in PRESETS]
        captured = (100.0 * np.mean([record.captured for record in each]) for each in of)
        made.append([policy, *(f"{score(each):.3f}" for each in of), *(f"{share:.0f}" for share in captured)])
    return made


def main() -> None:
    """Play what is missing and print a table of each id."""
    parser = Parser(prog="python -m benchmarks.robustness", description=__doc__)
    parser.add_argument("--env", nargs="+", default=["all"], help="ids, or all (default)")
    parser.add_argument("--policy", nargs="+", default=["all"], help="as of evaluate.py (default all)")
    parser.add_argument("--episodes", type=whole, default=100, help="test goals (default %(default)s)")
    what = "result folder, continued if it is there; default %(default)s"
    parser.add_argument("--output", type=Path, default=Path("results/robustness"), help=what)
    options = parser.parse_args()
    words = ["--env", *options.env, "--policy", *options.policy, "--episodes", str(options.episodes)]
    words += ["--output", str(options.output), "--no-pictures"]
    words += [word for preset in PRESETS for word in ("--perturb", preset)]
    if options.output.exists():
        words.append("--resume")
    if evaluate(words):
        raise SystemExit(1)
    for env_id, cells in grouped(read_records(options.output / "records.jsonl")).items():
        header = ["policy", *(f"score, {preset}" for preset in PRESETS)]
        header += [f"captured, {preset} [%]" for preset in PRESETS]
        print(f"\n**{env_id}**\n\n{markdown_table(header, rows(cells))}")
    print(f"\n{options.episodes} medium test goals, {machine_class()}.")


if __name__ == "__main__":
    sys.exit(exit_status("python -m benchmarks.robustness", main))
