"""State of a model of stable-baselines3 that a checkpoint holds, as plain values and arrays."""

from typing import Any

import numpy as np
import torch as th
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.off_policy_algorithm import OffPolicyAlgorithm

LARGEST_BUFFER = 256 * 2**20  # bytes of a replay buffer that goes into a checkpoint


def model_state(model: BaseAlgorithm) -> dict[str, Any]:
    """State of learning: parameters, optimisers, counters, and the replay buffer if it is small."""
    state: dict[str, Any] = {"parameters": model.get_parameters(), "num_timesteps": model.num_timesteps}
    state["n_updates"] = getattr(model, "_n_updates", 0)
    entropy = getattr(model, "log_ent_coef", None)
    if entropy is not None:
        state["log_ent_coef"] = entropy
    buffer = getattr(model, "replay_buffer", None)
    if isinstance(model, OffPolicyAlgorithm) and buffer is not None:
        state["episodes"] = model._episode_num
        names = ("observations", "next_observations", "actions", "rewards", "dones", "timeouts")
        end = buffer.buffer_size if buffer.full else buffer.pos
        arrays = {name: getattr(buffer, name)[:end] for name in names}
        if sum(array.nbytes for array in arrays.values()) <= LARGEST_BUFFER:
            state["replay"] = arrays | {"pos": buffer.pos, "full": buffer.full}
    return state


def restore_model(model: BaseAlgorithm, state: dict[str, Any]) -> None:
    """Put back what `model_state` gave into a model built from the same hyperparameters."""
    model.set_parameters(state["parameters"], exact_match=True, device=model.device)
    model.num_timesteps = state["num_timesteps"]
    model._n_updates = state["n_updates"]
    if "log_ent_coef" in state:
        with th.no_grad():
            model.log_ent_coef.copy_(state["log_ent_coef"])  # pyright: ignore[reportAttributeAccessIssue]
    if isinstance(model, OffPolicyAlgorithm):
        model._episode_num = state["episodes"]
        if "replay" in state and model.replay_buffer is not None:
            replay = dict(state["replay"])
            model.replay_buffer.pos, model.replay_buffer.full = replay.pop("pos"), replay.pop("full")
            for name, array in replay.items():
                getattr(model.replay_buffer, name)[: len(array)] = array
        else:
            # The buffer was too large for a checkpoint: fill it again before learning continues.
            model.learning_starts += model.num_timesteps


def random_state(model: BaseAlgorithm) -> dict[str, Any]:
    """The generators that learning draws from: torch's, numpy's global one and that of the actions."""
    return {
        "torch": th.get_rng_state(),
        "numpy": np.random.get_state(legacy=False),
        "actions": model.action_space.np_random.bit_generator.state,
    }


def restore_random_state(model: BaseAlgorithm, state: dict[str, Any]) -> None:
    """Put back what `random_state` gave."""
    th.set_rng_state(state["torch"])
    np.random.set_state(state["numpy"])
    model.action_space.np_random.bit_generator.state = state["actions"]
