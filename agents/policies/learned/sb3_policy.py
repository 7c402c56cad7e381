"""A policy from a zip that stable-baselines3 saved."""

from pathlib import Path

from agents.policies.learned.learned_policy import NetworkPolicy
from agents.policies.learned.sb3_zip import load_network
from space_envs.errors import PolicyError
from space_envs.policy import PolicyContext


class StableBaselinesPolicy(NetworkPolicy):
    """Acts by the network of a model that stable-baselines3's PPO, A2C, SAC, TD3 or DDPG saved.

    Args:
        context: of the environment it acts in.
        seed: of the noise where `predict` is asked not to be deterministic.
        path: of the zip.

    Raises:
        PolicyError: if the file cannot be read, holds a policy of another kind, or was made for observations
            or actions of other sizes.
    """

    def __init__(self, context: PolicyContext, seed: int, path: str | Path) -> None:
        network = load_network(path)
        for what, got, expected in (
            ("observations", network.inputs, context.layout.size),
            ("actions", network.outputs, len(context.action_scale)),
        ):
            if got != expected:
                raise PolicyError(
                    f"{path} was trained with {what} of size {got}; those of {context.env_id} in control "
                    f"mode {context.control_mode!r} have {expected}"
                )
        super().__init__(context, seed, network)
