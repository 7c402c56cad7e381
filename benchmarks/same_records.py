"""Compare records, observations and trained policies before and after a change, bit by bit.

Write them before the change and compare after it; the exit status is 1 if anything differs:

    python -m benchmarks.same_records --write before.json
    python -m benchmarks.same_records --compare before.json

Provenance, to which the robot and its digest belong, configuration hashes and timing are ignored.
Floating-point results are those of one machine and one set of versions: both runs need the
same ones.
"""

import argparse
import hashlib
import json
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
from tqdm import tqdm

from space_envs.system.command_line import Parser, exit_status
from space_envs.system.files import atomic_write_text

IDS = tuple(
    f"SpaceCapture/{name}-v0"
    for name in ("SingleArm", "SingleArmCluttered", "DualArmPlanar", "DualArmSpatial")
)
MODES = ("joint_velocity", "joint_torque", "end_effector_velocity", "reactionless")
PLANNERS = ("reactionless", "reactionless_local", "reactionless_free", "reactionless_rate")
IGNORED = ("timing", "checksum", "config_hash", "schema", "robot", "robot_digest")  # fields of a record
EPISODES = 2  # of each evaluation
STEPS = 60  # of random actions for each id and mode
TRAININGS = (("bc", "8000"), ("ppo", "20000"), ("sac", "6000"))  # algorithm, steps
ROOT = Path(__file__).resolve().parents[1]


def evaluations() -> Iterator[tuple[str, tuple[str, ...]]]:
    """Name and arguments of each evaluation."""
    for env_id in IDS:
        yield env_id, ("--env", env_id)
        for mode in MODES[1:]:
            yield f"{env_id}, {mode}", ("--env", env_id, "--policy", "random", "hold", "--control-mode", mode)
    for env_id in IDS[2:]:
        name = f"{env_id}, planners in mode reactionless"
        yield name, ("--env", env_id, "--policy", *PLANNERS, "--control-mode", MODES[3])
    physical = ("--env", IDS[0], "--variant", "physical", "--policy", "gjm", "mpc", "promp", "nmpc")
    yield f"{IDS[0]}, physical", physical
    yield f"{IDS[0]}, ood", ("--env", IDS[0], "--split", "ood", "--difficulty", "hard", "--policy", "gjm")


def records(arguments: tuple[str, ...]) -> dict[str, dict[str, Any]]:
    """Records of one evaluation without the ignored fields, by policy and episode."""
    with tempfile.TemporaryDirectory() as folder:
        options = ["--episodes", str(EPISODES), "--output", f"{folder}/results", "--no-pictures"]
        split = [] if "--split" in arguments else ["--split", "validation"]
        _run("evaluate.py", *arguments, *split, *options)
        lines = (Path(folder) / "results" / "records.jsonl").read_text(encoding="utf-8").splitlines()
    found = {}
    for line in lines:
        record = json.loads(line)
        compared = {name: value for name, value in record.items() if name not in IGNORED}
        found[f"{record['policy']}, episode {record['episode']}"] = compared
    return found


def steps(env_id: str, mode: str) -> str:
    """Digest of observations, rewards and episode ends of three environments under random actions."""
    env = gym.make_vec(env_id, num_envs=3, control_mode=mode)
    digest = hashlib.sha256()
    observation, _ = env.reset(seed=5)
    digest.update(observation.tobytes())
    for action in np.random.default_rng(7).uniform(
        -1, 1, env.action_space.shape and (STEPS, *env.action_space.shape)
    ):
        for part in env.step(action)[:4]:
            digest.update(np.ascontiguousarray(part).tobytes())
    env.close()
    return digest.hexdigest()


def trained(algorithm: str, count: str) -> str:
    """Digest of the network of a short training run."""
    with tempfile.TemporaryDirectory() as folder:
        options = ["--steps", count, "--output", f"{folder}/run", "--quiet", "--validation-episodes", "8"]
        start = ["--init", "none"] if algorithm == "ppo" else []
        _run("train.py", "--algo", algorithm, *start, *options)
        with np.load(Path(folder) / "run" / "policy.npz") as arrays:
            digest = hashlib.sha256()
            for name in sorted(arrays.files):
                if arrays[name].dtype.kind == "f":
                    digest.update(name.encode() + arrays[name].tobytes())
    return digest.hexdigest()


def measure(only: str) -> dict[str, Any]:
    """All measurements whose name contains `only`, by name."""
    found: dict[str, Any] = {}
    work: list[tuple[str, Any]] = [
        (name, lambda arguments=arguments: records(arguments)) for name, arguments in evaluations()
    ]
    work += [(f"steps of {i}, {m}", lambda i=i, m=m: steps(i, m)) for i in IDS for m in MODES]
    work += [(f"training {a}", lambda a=a, n=n: trained(a, n)) for a, n in TRAININGS]
    for name, call in tqdm([(name, call) for name, call in work if only in name], unit="part"):
        found[name] = call()
    return found


def differences(before: dict[str, Any], after: dict[str, Any], path: str = "") -> list[str]:
    """One line for each value that differs, with its path."""
    found = []
    for name in dict.fromkeys([*before, *after]):
        old, new, place = before.get(name), after.get(name), f"{path}{name}: "
        if isinstance(old, dict) and isinstance(new, dict):
            found += differences(old, new, place)
        elif old != new:
            found.append(f"{place}{old} before, {new} after")
    return found


def _run(*command: str) -> None:
    done = subprocess.run([sys.executable, *command], cwd=ROOT, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise SystemExit(f"{' '.join(command)} ended with {done.returncode}:\n{done.stderr}")


def main(arguments: list[str] | None = None) -> int:
    """Run the command; returns the exit status."""
    parser = Parser(
        prog="python -m benchmarks.same_records",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    what = parser.add_mutually_exclusive_group(required=True)
    what.add_argument("--write", type=Path, metavar="FILE", help="measure, and write to a file")
    what.add_argument("--compare", type=Path, metavar="FILE", help="measure, and compare with such a file")
    parser.add_argument("--only", default="", metavar="TEXT", help="parts whose name contains this text")
    options = parser.parse_args(arguments)
    before = None if options.compare is None else json.loads(options.compare.read_text(encoding="utf-8"))
    found = measure(options.only)
    if before is None:
        atomic_write_text(options.write, json.dumps(found, indent=1))
        return 0
    before = {name: value for name, value in before.items() if options.only in name}
    lines = differences(before, json.loads(json.dumps(found)))
    print("\n".join(lines) or f"{len(found)} parts are the same")
    return 1 if lines else 0


if __name__ == "__main__":
    sys.exit(exit_status("python -m benchmarks.same_records", main))
