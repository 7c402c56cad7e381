"""Vector environments with motions as actions, from the keywords of `gym.make_vec`."""

from typing import Any

from agents.motions.momentum import MomentumMotions
from agents.motions.simulated import SimulatedMotions
from agents.motions.vector import MotionVectorEnv
from space_envs.envs import CaptureVectorEnv
from space_envs.errors import unknown_name

DYNAMICS = ("simulation", "momentum")


def make_motions(
    env_id: str,
    num_envs: int = 1,
    motions: int = 1,
    duration: float | None = None,
    dynamics: str = "simulation",
    autoreset_mode: str = "next_step",
    **keywords: Any,
) -> MotionVectorEnv:
    """N episodes of a task whose actions are motions.

    Args:
        env_id: registered id of the task, or module:id. motions: actions in an episode. duration: s, of a
            motion; None is the usual share of the episode. dynamics: simulation, or momentum for one arm with
            a static goal, which is hundreds of times faster. **keywords: of the task.

    Raises:
        ConfigurationError: for a task with moving goals, and as `CaptureVectorEnv`.
    """
    if dynamics not in DYNAMICS:
        raise unknown_name("dynamics", dynamics, DYNAMICS)
    if dynamics == "momentum":
        env = CaptureVectorEnv(env_id, **keywords)
        return MomentumMotions(env, num_envs, motions, duration, autoreset_mode)
    env = CaptureVectorEnv(env_id, num_envs, autoreset_mode="disabled", **keywords)
    return SimulatedMotions(env, motions, duration, autoreset_mode)
