"""Start of an off-policy model from a policy: demonstrations, imitation, and a term in the actor's loss.

Without them the first updates of the actor follow a critic that knows nothing, and the policy is lost.
"""

from typing import Any, cast

import numpy as np
import torch as th
from numpy.typing import NDArray
from stable_baselines3.common.buffers import ReplayBuffer
from stable_baselines3.common.off_policy_algorithm import OffPolicyAlgorithm
from stable_baselines3.common.vec_env import VecEnv
from torch import nn
from torch.optim import Adam, Optimizer

from agents.learning.runs.hyperparameters import OffPolicy
from agents.learning.sb3.model import ACTIVATION_MODULES, actor_modules
from agents.policies.learned.network import Network

IMITATION_STEPS, IMITATION_RATE = 3_000, 1e-3  # of Adam, in which the actor becomes the initial policy
DISTURBED = 0.5  # share of the demonstrations' steps whose actions are disturbed


class InitialPolicy:
    """The policy that a model of stable-baselines3 starts from.

    Args:
        model: whose actor is to become it. network: the policy. parameters: of the run.

    Attributes:
        network: the policy. alone: whether the actor follows the policy alone, while the critic warms up.
    """

    def __init__(self, model: OffPolicyAlgorithm, network: Network, parameters: OffPolicy) -> None:
        self.network, self.alone = network, True
        self._model, self._parameters = model, parameters
        self._actor: Any = model.policy.actor
        self._policy = _Acting(network).to(model.device)
        self._actor.optimizer.register_step_pre_hook(self._add_gradient)
        model.learning_starts = 0  # no random actions

    def demonstrate(self) -> None:
        """Fill the replay buffer with steps of the policy, some of them disturbed, and imitate it there."""
        model, parameters = self._model, self._parameters
        env, buffer = cast(VecEnv, model.env), cast(ReplayBuffer, model.replay_buffer)
        generator = np.random.default_rng(np.random.randint(2**31))
        model._last_obs = seen = cast(NDArray, env.reset())
        model._last_episode_starts = np.ones(env.num_envs, dtype=bool)
        for _ in range(-(-parameters.demonstrations // env.num_envs)):
            actions = self._actions(seen)
            noise = parameters.action_deviation * generator.standard_normal(actions.shape)
            disturbed = generator.random((len(actions), 1)) < DISTURBED
            actions = np.clip(actions + disturbed * noise, -1.0, 1.0).astype(np.float32)
            following, reward, done, infos = env.step(actions)
            following = cast(NDArray, following)
            last = following.copy()
            for row in np.flatnonzero(done):
                last[row] = infos[row]["terminal_observation"]
            buffer.add(seen, last, actions, reward, done, infos)
            model.num_timesteps += env.num_envs
            model._last_obs = seen = following
        self._imitate()

    def _imitate(self) -> None:
        """Fit the actor to the policy where the demonstrations went, with small deviations of its actions."""
        optimizer = Adam(self._actor.parameters(), IMITATION_RATE)
        self._actor.set_training_mode(True)
        for _ in range(IMITATION_STEPS):
            optimizer.zero_grad()
            self._error().backward()
            optimizer.step()
        _, deviation = actor_modules(self._model)
        with th.no_grad():
            if isinstance(deviation, nn.Linear):
                deviation.weight.zero_()
                deviation.bias.fill_(float(np.log(self._parameters.action_deviation)))
        target = getattr(self._model, "actor_target", None)
        if target is not None:
            target.load_state_dict(self._actor.state_dict())

    def _actions(self, features: NDArray) -> NDArray[np.float32]:
        with th.no_grad():
            return self._policy(th.as_tensor(features, device=self._model.device)).cpu().numpy()

    def _error(self) -> th.Tensor:
        """Mean squared difference of the actor's mean action from the policy's, in sampled states."""
        buffer: Any = self._model.replay_buffer
        features = buffer.sample(self._parameters.batch_size).observations
        squash = {} if hasattr(self._model, "actor_target") else {"deterministic": True}
        return ((self._actor(features, **squash) - self._policy(features)) ** 2).mean()

    def _add_gradient(self, optimizer: Optimizer, args: Any, kwargs: Any) -> None:
        """Add the gradient of the cloning term before a step of the actor, or replace it by that."""
        if self.alone:
            optimizer.zero_grad()
        with th.enable_grad():
            (self._parameters.cloning_weight * self._error()).backward()


class _Acting(nn.Module):
    """Mean action of a network, as torch computes it."""

    def __init__(self, network: Network) -> None:
        super().__init__()
        layers: list[nn.Module] = []
        for weight, bias in zip(network.weights, network.biases, strict=True):
            layer = nn.Linear(*weight.shape)
            layer.weight = nn.Parameter(th.from_numpy(weight.T.copy()), requires_grad=False)
            layer.bias = nn.Parameter(th.from_numpy(bias.copy()), requires_grad=False)
            layers += [layer, ACTIVATION_MODULES[network.activation]()]
        layers[-1] = nn.Tanh() if network.squash else nn.Hardtanh()
        self.layers = nn.Sequential(*layers)

    def forward(self, features: th.Tensor) -> th.Tensor:
        """Actions (N, m) of features (N, F)."""
        return self.layers(features)
