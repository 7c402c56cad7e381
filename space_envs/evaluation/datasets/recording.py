"""Trajectories of a policy: played side by side, then each repeated alone in an environment of its own."""

from dataclasses import dataclass

import numpy as np

from space_envs.envs import CaptureEnv
from space_envs.evaluation.datasets.trajectory import Trajectory, first_difference, trajectory_of
from space_envs.evaluation.play.chunks import Chunk
from space_envs.evaluation.play.playing import roll_out


@dataclass(frozen=True)
class OmittedEpisode:
    """Episode that is not in a dataset: its number, the index of its goal, and the reason."""

    episode: int
    index: int
    reason: str


@dataclass(frozen=True, eq=False)
class Recorded:
    """Episodes of a chunk, in its order: trajectories for the dataset, and episodes omitted from it."""

    trajectories: tuple[Trajectory, ...]
    omitted: tuple[OmittedEpisode, ...]


def record(chunk: Chunk) -> Recorded:
    """Play a chunk's episodes on one thread, and keep those that come out alike when they are repeated.

    An episode in which the policy raises, or returns NaN, infinity or another shape, is omitted too.
    """
    with chunk.prepared():
        environment = {**chunk.environment, "threads": 1}
        rollout = roll_out(
            chunk.build,
            environment,
            chunk.task.split,
            np.array(chunk.indices),
            chunk.seed,
            apart=chunk.policy.foreign,
            policy=chunk.policy.name,
            first=chunk.first,
            as_float32=True,
        )
        env = CaptureEnv(**environment)
        trajectories, omitted = [], []
        for row in range(len(rollout)):
            reason = rollout.reason[row]
            if rollout.outcome[row] != "policy_error":
                trajectory = trajectory_of(rollout, row)
                reason = check(trajectory, env)
                if reason is None:
                    trajectories.append(trajectory)
                    continue
            omitted.append(OmittedEpisode(int(rollout.episode[row]), int(rollout.index[row]), reason))
        return Recorded(tuple(trajectories), tuple(omitted))


def check(trajectory: Trajectory, env: CaptureEnv) -> str | None:
    """Repeat a trajectory from its goal, seed and actions; None if every bit of it comes out again.

    Args:
        env: of the same task and control mode, whose split the goal's index is in.
    """
    observation, _ = env.reset(seed=trajectory.seed, options={"index": trajectory.index})
    observations, rewards, terminations, truncations = [observation], [], [], []
    outcome = "running"
    for action in trajectory.actions:
        if outcome != "running":
            break
        observation, reward, terminated, truncated, info = env.step(action)
        observations.append(observation)
        rewards.append(reward)
        terminations.append(terminated)
        truncations.append(truncated)
        outcome = info["outcome"]
    repeated = Trajectory(
        episode=trajectory.episode,
        index=trajectory.index,
        seed=trajectory.seed,
        outcome=outcome,
        observations=np.array(observations),
        actions=trajectory.actions[: len(rewards)],
        rewards=np.array(rewards),
        terminations=np.array(terminations, dtype=bool),
        truncations=np.array(truncations, dtype=bool),
    )
    difference = first_difference(trajectory, repeated)
    return None if difference is None else f"the replay from its actions differs: {difference}"
