"""Training of a network that plans: goals of the train split, labels, validations and checkpoints."""

from typing import Any

import numpy as np
import torch as th
from torch import nn

from agents.learning.planners.labels import KeptLabels, ReactionlessLabels
from agents.learning.planners.self_labelled import Fitting, SelfLabelled
from agents.learning.progress import Progress
from agents.learning.runs.hyperparameters import Planner
from agents.learning.runs.session import Session
from agents.policies.learned.features import FeatureView
from agents.policies.learned.network import Network
from agents.policies.learned.planner_network import plan_duration
from agents.policies.learned.policy_file import PlanFormat
from space_envs.dynamics.rotations import Array
from space_envs.envs import CaptureVectorEnv
from space_envs.errors import ConfigurationError
from space_envs.tasks.common import DIFFICULTIES

LABELS = {"kept": KeptLabels, "reactionless": ReactionlessLabels}  # by the kind of plans
OUTPUT_SCALE = 0.1  # of the last layer's initial weights
RESET = 512  # episodes that are started at once, for their observations
ACTIVATIONS = {
    "tanh": nn.Tanh,
    "relu": nn.ReLU,
    "leaky_relu": nn.LeakyReLU,
    "elu": nn.ELU,
    "silu": nn.SiLU,
    "gelu": nn.GELU,
}


class PlannerTraining:
    """Trains a network that plans.

    A checkpoint holds the labels and generators too, so that a run that was killed and resumed ends with the
    same bits as one that was not, unless its time limit is reached.

    Args:
        session: of the run, with hyperparameters of Planner.

    Attributes:
        view: from observations to the network's inputs. plans: meaning of its outputs.
    """

    def __init__(self, session: Session) -> None:
        settings, parameters = session.settings, session.parameters
        if not isinstance(parameters, Planner):
            raise ConfigurationError("training of a planner needs the hyperparameters of planner")
        self.parameters = parameters
        self.context = settings.context()
        self.view = FeatureView(parameters.features, self.context.layout, self.context.arm.home)
        duration = plan_duration(self.context, parameters.kind)
        self.plans = PlanFormat(parameters.kind, duration)
        observations = training_observations(settings.env_id, settings.environment, parameters.goals)
        labels = LABELS[parameters.kind](
            self.context, observations, self.view(observations), parameters, duration
        )
        start = labels.start(np.random.default_rng(settings.seed))
        generator = th.Generator().manual_seed(settings.seed)
        network = build_network(parameters, self.view.size, start, generator)
        fitting = Fitting(
            goals=parameters.num_envs,
            rounds=parameters.steps // parameters.round,
            minibatch=parameters.batch_size,
            reuse=parameters.reuse,
            memory=parameters.memory,
            learning_rate=parameters.learning_rate,
            averaging=parameters.averaging,
        )
        self._fit = SelfLabelled(network, labels, fitting, settings.seed)

    @property
    def network(self) -> Network:
        """The averaged network as it is now."""
        return exported(self._fit.average, self.parameters.activation)

    def state(self) -> dict[str, Any]:
        """State for `restore`."""
        return {"fit": self._fit.state()}

    def restore(self, state: dict[str, Any]) -> None:
        """Go back to a checkpoint."""
        self._fit.restore(state["fit"])

    def run(self, progress: Progress) -> int:
        """Train to the end of the rounds or the time limit; returns the goals labelled."""
        goals, interval = self.parameters.round, self.parameters.validation_interval
        steps = recorded = self._fit.rounds * goals
        while steps < self.parameters.steps and not progress.budget.exhausted:
            progress.logger.record("train/squared_step", self._fit.round())
            steps += goals
            progress.bar.update(goals)
            if steps - recorded >= interval:
                progress.logger.dump(steps)
                progress.checkpoint(steps, self.network, self.state())
                recorded = steps
        if recorded < steps:
            progress.checkpoint(steps, self.network, self.state())
        return steps


def training_observations(env_id: str, keywords: dict[str, Any], goals: int) -> Array:
    """Observations (G, size) at the start of the first episodes of the train split, of all difficulties.

    Args:
        goals: of each difficulty, or all that there are.
    """
    found = []
    for difficulty in DIFFICULTIES:
        own = {**keywords, "difficulty": difficulty}
        count = min(RESET, goals)
        env = CaptureVectorEnv(env_id, count, autoreset_mode="disabled", split="train", **own)
        for first in range(0, min(goals, env.task.split_size("train")) - count + 1, count):
            index = first + np.arange(count)
            observation, _ = env.reset(seed=0, options={"split": "train", "index": index})
            found.append(np.asarray(observation, dtype=np.float64).copy())
    return np.concatenate(found)


def build_network(parameters: Planner, inputs: int, start: Array, generator: th.Generator) -> nn.Sequential:
    """A perceptron whose outputs are close to one point (m,), at which all plans start."""
    layers: list[nn.Module] = []
    for width in parameters.hidden:
        layers += [_linear(inputs, width, generator), ACTIVATIONS[parameters.activation]()]
        inputs = width
    last = _linear(inputs, len(start), generator)
    with th.no_grad():
        last.weight.mul_(OUTPUT_SCALE)
        last.bias.copy_(th.from_numpy(start))
    return nn.Sequential(*layers, last)


def _linear(inputs: int, outputs: int, generator: th.Generator) -> nn.Linear:
    """A layer with torch's usual initial weights, drawn from a generator."""
    layer = nn.Linear(inputs, outputs)
    with th.no_grad():
        for parameter in layer.parameters():
            parameter.uniform_(-(inputs**-0.5), inputs**-0.5, generator=generator)
    return layer


def exported(network: nn.Module, activation: str) -> Network:
    """The network as plain arrays; its outputs are not random."""
    layers = [layer for layer in network.children() if isinstance(layer, nn.Linear)]
    width, outputs = layers[-1].in_features, layers[-1].out_features
    return Network(
        weights=tuple(np.ascontiguousarray(layer.weight.detach().numpy().T) for layer in layers),
        biases=tuple(layer.bias.detach().numpy().copy() for layer in layers),
        deviation_weight=np.zeros((width, outputs), dtype=np.float32),
        deviation_bias=np.full(outputs, -20.0, dtype=np.float32),
        activation=activation,
        squash=False,
    )
