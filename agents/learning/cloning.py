"""Behaviour cloning: a network learns the actions of an expert in the states that the network visits."""

import shutil
from pathlib import Path
from typing import Any

import numpy as np
import torch as th
from numpy.typing import NDArray

from agents.learning.progress import Progress
from agents.learning.runs.hyperparameters import BC
from agents.learning.runs.nested_npz import load_nested, save_nested
from agents.learning.runs.session import Session
from agents.learning.sb3.model import actor_modules, build_model, export_network
from agents.learning.sb3.state import model_state, restore_model
from agents.learning.sb3.vec_env import NativeVecEnv
from agents.policies.learned.features import FeatureView
from agents.policies.learned.network import Network
from agents.policies.registry import make_policy
from space_envs.dynamics.rotations import Array
from space_envs.envs import CaptureVectorEnv
from space_envs.errors import ConfigurationError
from space_envs.evaluation.play.steps import steps
from space_envs.policy import Policy, PolicyContext

Pairs = dict[str, NDArray[np.float32]]  # features (K, F) and actions (K, m)


class _Labelled:
    """Policy that acts by a network or a disturbed expert, and stores the expert's action at every step.

    Args:
        network: None for the expert, which acts also if it has a state.
        noise: standard deviation of what disturbs the expert in half of its steps.

    Attributes:
        features: (N, F) of every step so far. actions: (N, m) of the expert.
    """

    def __init__(
        self,
        expert: Policy,
        view: FeatureView,
        network: Network | None,
        noise: float,
        generator: np.random.Generator,
    ) -> None:
        self._expert, self._view, self._network = expert, view, network
        self._noise, self._generator = noise, generator
        self.features: list[NDArray[np.float32]] = []
        self.actions: list[NDArray[np.float32]] = []

    def predict(
        self,
        observation: Array,
        state: Any = None,
        episode_start: NDArray[np.bool_] | None = None,
        deterministic: bool = True,
    ) -> tuple[Array, Any]:
        """Actions (N, m) and the expert's next state, as in `Policy.predict`."""
        features = self._view(observation)
        label, state = self._expert.predict(observation, state=state, episode_start=episode_start)
        self.features.append(features)
        self.actions.append(label.astype(np.float32))
        if self._network is not None and state is None:
            return np.clip(self._network.actions(features), -1.0, 1.0), state
        disturbed = self._generator.random((len(label), 1)) < 0.5
        noise = self._noise * disturbed * self._generator.standard_normal(label.shape)
        return np.clip(label + noise, -1.0, 1.0), state


class Cloning:
    """Rounds of collecting labelled states and fitting the network to all of them (DAgger).

    Every round draws from a seed of its own, so that a run that was killed and resumed ends with the same
    bits as one that was not.

    Args:
        session: of the run, with hyperparameters of BC. The data so far lie in the folder `demonstrations`
            of the run until it ends.

    Raises:
        ConfigurationError, PolicyError: for an unknown expert, or one of another control mode.
    """

    def __init__(self, session: Session) -> None:
        settings, parameters = session.settings, session.parameters
        if not isinstance(parameters, BC) or parameters.expert is None:
            raise ConfigurationError("cloning needs the hyperparameters of bc, and an expert")
        self.settings, self.parameters = settings, parameters
        self.context = PolicyContext.from_env(
            CaptureVectorEnv(settings.env_id, **settings.environment), jobs=-1
        )
        self.expert = make_policy(parameters.expert, self.context, settings.seed)
        # Neither a capture nor the task's horizon ends an episode.
        endless = {
            "horizon": parameters.episode_steps,
            "hold_time": 2.0 * parameters.episode_steps * self.context.control_period,
        }
        keywords = {**settings.environment, **endless}
        self.env = CaptureVectorEnv(
            settings.env_id, parameters.num_envs, autoreset_mode="same_step", **keywords
        )
        self.view = FeatureView(parameters.features, self.context.layout, self.context.arm.home)
        self.model = build_model(
            parameters, NativeVecEnv(self.env, self.view), settings.seed, settings.device
        )
        layers, _ = actor_modules(self.model)
        self.actor = [parameter for layer in layers for parameter in layer.parameters()]
        self.optimizer = th.optim.Adam(self.actor, parameters.learning_rate)
        self.steps_a_round = parameters.round
        self.rounds = -(-parameters.steps // self.steps_a_round)
        self.steps = 0  # taken so far
        self._shards = session.folder.path / "demonstrations"
        self._data: list[Pairs] = []

    @property
    def network(self) -> Network:
        """The network as it is now."""
        return export_network(self.model, self.parameters.activation)

    def state(self) -> dict[str, Any]:
        """State for `restore`, without the data, which have their own files."""
        return {"model": model_state(self.model), "optimizer": self.optimizer.state_dict()}

    def restore(self, state: dict[str, Any]) -> None:
        """Go back to a checkpoint."""
        restore_model(self.model, state["model"])
        self.optimizer.load_state_dict(state["optimizer"])
        self.steps = state["steps"]
        self._data = [load_nested(self._shard(i)) for i in range(self.steps // self.steps_a_round)]

    def run(self, progress: Progress) -> int:
        """Clone to the end of the rounds or the time limit; returns the steps taken."""
        recorded = self.steps
        for index in range(self.steps // self.steps_a_round, self.rounds):
            if index and progress.budget.exhausted:
                break
            last = index == self.rounds - 1
            loss = self._round(index, self.parameters.last_epochs if last else self.parameters.epochs)
            progress.bar.update(self.steps_a_round)
            progress.logger.record("train/loss", loss)
            progress.logger.dump(self.steps)
            if last or self.steps - recorded >= self.parameters.validation_interval:
                progress.checkpoint(self.steps, self.network, self.state())
                recorded = self.steps
        if recorded < self.steps:
            progress.checkpoint(self.steps, self.network, self.state())
        return self.steps

    def _round(self, index: int, epochs: int) -> float:
        """Collect, store and fit once; returns the loss."""
        pairs = self._collect(index)
        save_nested(self._shard(index), pairs)
        self._data.append(pairs)
        self.steps += self.steps_a_round
        return self._fit(index, epochs)

    def forget(self) -> None:
        """Delete the data of a finished run."""
        shutil.rmtree(self._shards, ignore_errors=True)

    def _shard(self, index: int) -> Path:
        return self._shards / f"round_{index:03d}.npz"

    def _collect(self, index: int) -> Pairs:
        """States that the expert (round 0, or a planner) or the network visits, with the expert's actions."""
        seeds = np.random.SeedSequence([self.settings.seed, index])
        network = self.network if index else None
        labelled = _Labelled(
            self.expert, self.view, network, self.parameters.expert_noise, np.random.default_rng(seeds)
        )
        observation, _ = self.env.reset(seed=int(seeds.generate_state(1)[0]))
        for _ in steps(labelled, self.env, observation):
            pass
        return {
            "features": np.concatenate(labelled.features),
            "actions": np.concatenate(labelled.actions),
        }

    def _fit(self, index: int, epochs: int) -> float:
        """Passes over all data so far; returns the last one's mean weighted squared error."""
        parameters = self.parameters
        device = self.model.device
        features = th.from_numpy(np.concatenate([pairs["features"] for pairs in self._data])).to(device)
        actions = th.from_numpy(np.concatenate([pairs["actions"] for pairs in self._data])).to(device)
        generator = th.Generator().manual_seed(self.settings.seed * 1_000 + index)
        size = min(parameters.batch_size, len(features))
        batches = len(features) // size
        total = 0.0
        for epoch in range(epochs):
            order = th.randperm(len(features), generator=generator).to(device)
            total = 0.0
            for batch in range(batches):
                past = (epoch * batches + batch) / (epochs * batches)
                self.optimizer.param_groups[0]["lr"] = parameters.learning_rate * (
                    1.0 - (1.0 - parameters.final_rate_ratio) * past
                )
                rows = order[batch * size : (batch + 1) * size]
                loss = self._loss(features[rows], actions[rows])
                self.optimizer.zero_grad()
                loss.backward()
                self.optimizer.step()
                total += float(loss.detach())
        return total / batches

    def _loss(self, features: th.Tensor, actions: th.Tensor) -> th.Tensor:
        """Mean squared error relative to the expert's action: near the goal small errors count."""
        policy: Any = self.model.policy
        mean = policy.action_net(policy.mlp_extractor.forward_actor(features))
        size = actions.abs().mean(dim=1, keepdim=True) + self.parameters.error_offset
        return (((mean - actions) / size) ** 2).mean()
