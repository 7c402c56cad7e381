"""stable-baselines3 models: built from hyperparameters, exported to a policy file, saved and restored."""

from typing import Any

import numpy as np
import torch as th
from stable_baselines3 import PPO, SAC, TD3
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.noise import NormalActionNoise
from stable_baselines3.common.off_policy_algorithm import OffPolicyAlgorithm
from stable_baselines3.common.type_aliases import Schedule
from stable_baselines3.common.vec_env import VecEnv
from torch import nn

from agents.learning import hyperparameters as tables
from agents.learning.hyperparameters import AnyHyperparameters
from agents.policies.learned.network import Network
from space_envs.errors import PolicyError

_ACTIVATIONS: dict[str, type[nn.Module]] = {  # under the names of agents.policies.learned.network
    "tanh": nn.Tanh,
    "relu": nn.ReLU,
    "leaky_relu": nn.LeakyReLU,
    "elu": nn.ELU,
    "silu": nn.SiLU,
    "gelu": nn.GELU,
}
# Hyperparameters that go to stable-baselines3 under their own names.
_PPO = "n_steps n_epochs gae_lambda clip_range ent_coef vf_coef max_grad_norm target_kl"
_OFF_POLICY = "buffer_size learning_starts tau train_freq gradient_steps"
_SAC = "ent_coef target_entropy"
_TD3 = "policy_delay target_policy_noise target_noise_clip"
LARGEST_BUFFER = 256 * 2**20  # bytes of a replay buffer that goes into a checkpoint


def build_model(
    parameters: AnyHyperparameters, env: VecEnv, seed: int, device: str, rate: Schedule | None = None
) -> BaseAlgorithm:
    """The model that an algorithm's hyperparameters describe; a BC table gives the PPO model it fills.

    Args:
        rate: learning rate by progress remaining; None is constant.
    """
    sizes = list(parameters.hidden)
    policy: dict[str, Any] = {"activation_fn": _ACTIVATIONS[parameters.activation], "net_arch": sizes}
    common: dict[str, Any] = {
        "learning_rate": rate or parameters.learning_rate,
        "batch_size": parameters.batch_size,
        "gamma": parameters.gamma,
        "seed": seed,
        "device": device,
        "policy_kwargs": policy,
    }
    if isinstance(parameters, tables.PPO | tables.BC):
        policy["net_arch"] = {"pi": sizes, "vf": sizes}
        policy["log_std_init"] = float(np.log(parameters.deviation))
        if isinstance(parameters, tables.BC):
            # Its rollouts are never used: the smallest that stable-baselines3 takes without complaint.
            common |= {"n_steps": 2, "batch_size": 2}
            return PPO("MlpPolicy", env, **common)
        return PPO("MlpPolicy", env, **common, **_values(parameters, _PPO))
    common |= _values(parameters, _OFF_POLICY)
    if isinstance(parameters, tables.SAC):
        return SAC("MlpPolicy", env, **common, **_values(parameters, _SAC))
    size = env.action_space.shape or (0,)
    noise = NormalActionNoise(np.zeros(size), np.full(size, parameters.exploration))
    return TD3("MlpPolicy", env, action_noise=noise, **common, **_values(parameters, _TD3))


def _values(parameters: AnyHyperparameters, names: str) -> dict[str, Any]:
    return {name: getattr(parameters, name) for name in names.split()}


def actor_modules(model: BaseAlgorithm) -> tuple[list[nn.Linear], nn.Linear | nn.Parameter | None]:
    """Linear layers from features to the mean action, and what gives the log standard deviation."""
    if isinstance(model, PPO):
        policy: Any = model.policy
        return [*_linear(policy.mlp_extractor.policy_net), policy.action_net], policy.log_std
    actor: Any = model.policy.actor
    if isinstance(model, SAC):
        return [*_linear(actor.latent_pi), actor.mu], actor.log_std
    return _linear(actor.mu), None


def _linear(network: nn.Module) -> list[nn.Linear]:
    return [layer for layer in network.children() if isinstance(layer, nn.Linear)]


def actor_parameters(model: BaseAlgorithm) -> list[nn.Parameter]:
    """Parameters that only the policy uses."""
    layers, deviation = actor_modules(model)
    found = [parameter for layer in layers for parameter in layer.parameters()]
    if isinstance(deviation, nn.Linear):
        return found + list(deviation.parameters())
    return found if deviation is None else [*found, deviation]


def export_network(model: BaseAlgorithm, activation: str) -> Network:
    """The actor as plain arrays."""
    layers, deviation = actor_modules(model)
    last = layers[-1]
    if isinstance(deviation, nn.Linear):
        weight, bias = _matrix(deviation), _array(deviation.bias)
    else:
        weight = np.zeros((last.in_features, last.out_features), dtype=np.float32)
        # TD3 has no deviation of its own: e^-20 is none.
        bias = np.full(last.out_features, -20.0, dtype=np.float32) if deviation is None else _array(deviation)
    return Network(
        weights=tuple(_matrix(layer) for layer in layers),
        biases=tuple(_array(layer.bias) for layer in layers),
        deviation_weight=weight,
        deviation_bias=bias,
        activation=activation,
        squash=not isinstance(model, PPO),
    )


def import_network(model: BaseAlgorithm, network: Network) -> None:
    """Fill a PPO model's actor with a network; the exploration stays the model's own.

    Raises:
        PolicyError: if the layers differ.
    """
    layers, _ = actor_modules(model)
    wanted = [(layer.in_features, layer.out_features) for layer in layers]
    got = [weight.shape for weight in network.weights]
    if not isinstance(model, PPO) or network.squash or wanted != got:
        raise PolicyError(
            f"the policy to start from has layers {got}, the model {wanted}; only ppo can start from one"
        )
    with th.no_grad():
        for layer, weight, bias in zip(layers, network.weights, network.biases, strict=True):
            layer.weight.copy_(th.from_numpy(weight.T.copy()))
            layer.bias.copy_(th.from_numpy(bias))


def model_state(model: BaseAlgorithm) -> dict[str, Any]:
    """Everything that learning goes on from: parameters, optimisers, counters and a small replay buffer."""
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
            # The buffer was too large for a checkpoint: fill it again before learning goes on.
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


def _matrix(layer: nn.Linear) -> np.ndarray:
    return np.ascontiguousarray(_array(layer.weight).T)


def _array(parameter: th.Tensor) -> np.ndarray:
    return parameter.detach().cpu().numpy().astype(np.float32)
