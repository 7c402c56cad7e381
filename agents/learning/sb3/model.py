"""Models of stable-baselines3: built from hyperparameters, their actors as plain networks and back."""

from importlib import import_module
from typing import Any

import numpy as np
import torch as th
from stable_baselines3 import PPO, SAC, TD3
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.noise import NormalActionNoise
from stable_baselines3.common.type_aliases import Schedule
from stable_baselines3.common.vec_env import VecEnv
from torch import nn

from agents.learning.runs import hyperparameters as tables
from agents.learning.runs.hyperparameters import AnyHyperparameters
from agents.policies.learned.network import Network
from space_envs.errors import ConfigurationError, PolicyError

ACTIVATION_MODULES: dict[str, type[nn.Module]] = {  # under the names of agents.policies.learned.network
    "tanh": nn.Tanh,
    "relu": nn.ReLU,
    "leaky_relu": nn.LeakyReLU,
    "elu": nn.ELU,
    "silu": nn.SiLU,
    "gelu": nn.GELU,
}
# Hyperparameters that go to stable-baselines3 under their own names.
_PPO = "n_steps n_epochs gae_lambda clip_range ent_coef vf_coef max_grad_norm target_kl"
_OFF_POLICY = "buffer_size learning_starts train_freq gradient_steps"
_SAC = "tau ent_coef target_entropy"
_TQC = f"{_SAC} top_quantiles_to_drop_per_net"
_CROSSQ = "ent_coef target_entropy policy_delay"
_TD3 = "tau policy_delay target_policy_noise target_noise_clip"


def build_model(
    parameters: AnyHyperparameters, env: VecEnv, seed: int, device: str, rate: Schedule | None = None
) -> BaseAlgorithm:
    """The model that an algorithm's hyperparameters describe; those of BC give the PPO model that it fits.

    Args:
        rate: learning rate by progress remaining; None is constant.

    Raises:
        ConfigurationError: for a network that plans, which stable-baselines3 does not train.
    """
    if isinstance(parameters, tables.Planner):
        raise ConfigurationError("a network that plans is no model of stable-baselines3")
    sizes = list(parameters.hidden)
    policy: dict[str, Any] = {"activation_fn": ACTIVATION_MODULES[parameters.activation], "net_arch": sizes}
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
        policy["log_std_init"] = float(np.log(parameters.action_deviation))
        if isinstance(parameters, tables.BC):
            # Its rollouts are never used: the smallest that stable-baselines3 takes without complaint.
            common |= {"n_steps": 2, "batch_size": 2}
            return PPO("MlpPolicy", env, **common)
        return PPO("MlpPolicy", env, **common, **_values(parameters, _PPO))
    common |= _values(parameters, _OFF_POLICY)
    if isinstance(parameters, tables.TQC):
        return import_module("sb3_contrib").TQC("MlpPolicy", env, **common, **_values(parameters, _TQC))
    if isinstance(parameters, tables.CrossQ):
        return import_module("sb3_contrib").CrossQ("MlpPolicy", env, **common, **_values(parameters, _CROSSQ))
    if isinstance(parameters, tables.SAC):
        return SAC("MlpPolicy", env, **common, **_values(parameters, _SAC))
    size = env.action_space.shape or (0,)
    noise = NormalActionNoise(np.zeros(size), np.full(size, parameters.exploration_noise))
    return TD3("MlpPolicy", env, action_noise=noise, **common, **_values(parameters, _TD3))


def _values(parameters: AnyHyperparameters, names: str) -> dict[str, Any]:
    return {name: getattr(parameters, name) for name in names.split()}


def actor_modules(model: BaseAlgorithm) -> tuple[list[nn.Linear], nn.Linear | nn.Parameter | None]:
    """Linear layers from features to the mean action, and what gives the log standard deviation."""
    if isinstance(model, PPO):
        policy: Any = model.policy
        return [*_linear(policy.mlp_extractor.policy_net), policy.action_net], policy.log_std
    actor: Any = model.policy.actor
    if isinstance(model, TD3):
        return _linear(actor.mu), None
    return [*_linear(actor.latent_pi), actor.mu], actor.log_std


def _linear(network: nn.Module) -> list[nn.Linear]:
    return [layer for layer in network.children() if isinstance(layer, nn.Linear)]


def _normalisations(model: BaseAlgorithm) -> list[nn.Module]:
    """Normalisations before each linear layer of the actor; none but for CrossQ."""
    latent = getattr(getattr(model.policy, "actor", None), "latent_pi", nn.Module())
    return [layer for layer in latent.children() if hasattr(layer, "ra_mean")]


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
    last, normalisations = layers[-1], _normalisations(model) or [None] * len(layers)
    pairs = [_folded(layer, before) for layer, before in zip(layers, normalisations, strict=True)]
    if isinstance(deviation, nn.Linear):
        weight, bias = _folded(deviation, normalisations[-1])
    else:
        weight = np.zeros((last.in_features, last.out_features), dtype=np.float32)
        # TD3 has no deviation of its own: e^-20 is none.
        bias = np.full(last.out_features, -20.0, dtype=np.float32) if deviation is None else _array(deviation)
    return Network(
        weights=tuple(pair[0] for pair in pairs),
        biases=tuple(pair[1] for pair in pairs),
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
    expected = [(layer.in_features, layer.out_features) for layer in layers]
    got = [weight.shape for weight in network.weights]
    if not isinstance(model, PPO) or network.squash or expected != got:
        raise PolicyError(
            f"the policy to start from has layers {got}, the model {expected}; only ppo can start from one"
        )
    with th.no_grad():
        for layer, weight, bias in zip(layers, network.weights, network.biases, strict=True):
            layer.weight.copy_(th.from_numpy(weight.T.copy()))
            layer.bias.copy_(th.from_numpy(bias))


def _folded(layer: nn.Linear, normalisation: Any) -> tuple[np.ndarray, np.ndarray]:
    """Weight (in, out) and bias of a layer, together with what normalises its inputs, if anything does."""
    weight, bias = np.ascontiguousarray(_array(layer.weight).T), _array(layer.bias)
    if normalisation is None:
        return weight, bias
    mean, variance = _array(normalisation.ra_mean), _array(normalisation.ra_var)
    scale = _array(normalisation.scale) / np.sqrt(variance + normalisation.eps)
    shift = _array(normalisation.bias) - scale * mean
    return (scale[:, None] * weight).astype(np.float32), (bias + shift @ weight).astype(np.float32)


def _array(parameter: th.Tensor) -> np.ndarray:
    return parameter.detach().cpu().numpy().astype(np.float32)
