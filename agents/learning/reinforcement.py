"""Reinforcement learning with stable-baselines3 over the native vector environment."""

from typing import Any

import numpy as np
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.off_policy_algorithm import OffPolicyAlgorithm

from agents.learning.progress import Progress
from agents.learning.runs.hyperparameters import PPO, OffPolicy
from agents.learning.runs.session import Session
from agents.learning.sb3.initial import InitialPolicy
from agents.learning.sb3.model import actor_parameters, build_model, export_network, import_network
from agents.learning.sb3.state import model_state, random_state, restore_model, restore_random_state
from agents.learning.sb3.vec_env import NativeVecEnv
from agents.policies.learned.features import FeatureView
from agents.policies.learned.network import Network
from space_envs.envs import CaptureVectorEnv


class Reinforcement:
    """A stable-baselines3 model that learns until its steps or its time are used up.

    A checkpoint holds the episodes, the generators and the replay buffer too, so that a run that was killed
    and resumed ends with the same bits as one that was not, with two exceptions: a limit on the wall time
    that is reached, and a replay buffer that is too large for a checkpoint.

    Args:
        session: of the run, with hyperparameters of PPO or OffPolicy.

    Raises:
        ConfigurationError: for settings that the environment does not know.
    """

    def __init__(self, session: Session) -> None:
        settings, parameters = session.settings, session.parameters
        self.session, self.parameters, self.budget = session, parameters, session.budget
        # Wall time when learning started, s; the learning rate of ppo falls from then on.
        self.start_time = session.budget.wall
        env = CaptureVectorEnv(
            settings.env_id, parameters.num_envs, autoreset_mode="same_step", **settings.environment
        )
        self.view = FeatureView(parameters.features, env.task.layout, env.task.mechanics.home)
        seed = int(np.random.SeedSequence([settings.seed, 0]).generate_state(1)[0])
        rate = self._rate if isinstance(parameters, PPO) else None
        self.episodes = NativeVecEnv(env, self.view)
        self.model: BaseAlgorithm = build_model(parameters, self.episodes, seed, settings.device, rate)
        self.warm = False  # whether the actor was warm started, and the critic has to catch up first
        self.learned = False  # whether the actor has been updated
        self.initial: InitialPolicy | None = None  # of an off-policy model

    @property
    def network(self) -> Network:
        """The actor as it is now."""
        return export_network(self.model, self.parameters.activation)

    def start_from(self, network: Network) -> None:
        """Warm start the actor; errors as in `import_network`."""
        self.warm = True
        if isinstance(self.parameters, OffPolicy):
            self._keep(network).demonstrate()
        else:
            import_network(self.model, network)

    def _keep(self, network: Network) -> InitialPolicy:
        """The initial policy of an off-policy model, to be imitated."""
        if not isinstance(self.model, OffPolicyAlgorithm) or not isinstance(self.parameters, OffPolicy):
            raise TypeError(f"{type(self.model).__name__} has no replay buffer")
        self.initial = InitialPolicy(self.model, network, self.parameters)
        return self.initial

    def state(self) -> dict[str, Any]:
        """State for `restore`."""
        state = {
            "model": model_state(self.model),
            "random": random_state(self.model),
            "start_time": self.start_time,
            "warm": self.warm,
            "learned": self.learned,
        }
        if self.initial is not None:
            state["initial"] = dict(vars(self.initial.network))
        if self.model._last_obs is not None:  # episodes have been started
            state["episodes"] = self.episodes.snapshot()
            state["seen"] = self.model._last_obs
            state["starts"] = self.model._last_episode_starts
        return state

    def restore(self, state: dict[str, Any]) -> None:
        """Go back to a checkpoint."""
        restore_model(self.model, state["model"])
        if "initial" in state:
            self._keep(Network(**state["initial"]))
        self.start_time, self.warm, self.learned = state["start_time"], state["warm"], state["learned"]
        if "episodes" in state:
            self.episodes.restore(state["episodes"])
            self.model._last_obs, self.model._last_episode_starts = state["seen"], state["starts"]
        restore_random_state(self.model, state["random"])

    def run(self, progress: Progress) -> int:
        """Learn to the end of the steps or the time limit; returns the steps taken."""
        if self.warm and not progress.history:
            self.record(progress, candidate=False)  # the policy that the run starts from, to compare with
        self.model.set_logger(progress.logger)
        remaining = self.parameters.steps - self.model.num_timesteps
        callback = _AtIntervals(self, progress)
        if remaining > 0 and not self.budget.exhausted:
            self.model.learn(remaining, callback=callback, log_interval=10, reset_num_timesteps=False)
        none = not progress.folder.policy.exists()
        if callback.recorded < self.model.num_timesteps or none:
            self.record(progress, self.learned or none)
        return self.model.num_timesteps

    def record(self, progress: Progress, candidate: bool) -> None:
        """Validate the actor as it is now, and save it if it is a candidate and the best."""
        progress.checkpoint(self.model.num_timesteps, self.network, self.state(), candidate)

    def hold_actor(self) -> None:
        """Freeze the actor while the critic warms up; call before every rollout."""
        if isinstance(self.parameters, PPO):
            learns = not self.warm or self.model.num_timesteps >= self.parameters.critic_warm_up
            for parameter in actor_parameters(self.model):
                parameter.requires_grad_(learns)
            self.learned |= learns
        elif isinstance(self.parameters, OffPolicy):
            first = self.parameters.demonstrations + self.parameters.critic_warm_up
            self.learned |= not self.warm or self.model.num_timesteps >= first
            if self.initial is not None:
                self.initial.alone = not self.learned

    def _rate(self, remaining: float) -> float:
        """Learning rate of ppo, falling linearly with the steps or the time, whichever runs out first."""
        parameters = self.parameters
        final = parameters.final_rate_ratio if isinstance(parameters, PPO) else 1.0
        remaining = min(remaining, 1.0 - self.budget.fraction(self.start_time))
        return parameters.learning_rate * (final + (1.0 - final) * max(remaining, 0.0))


class _AtIntervals(BaseCallback):
    """Validates at intervals, between an update and the next rollout, and ends the run at its time limit."""

    def __init__(self, learner: Reinforcement, progress: Progress) -> None:
        super().__init__()
        self._learner, self._progress = learner, progress
        self.recorded = learner.model.num_timesteps

    def _on_rollout_start(self) -> None:
        if self.num_timesteps - self.recorded >= self._learner.parameters.validation_interval:
            self._learner.record(self._progress, self._learner.learned)
            self.recorded = self.num_timesteps
        self._learner.hold_actor()

    def _on_step(self) -> bool:
        self._progress.bar.update(self.training_env.num_envs)
        return not self._learner.budget.exhausted
