"""Training of a network on its own outputs after a Gauss-Newton step (amortised optimisation).

Each plan that the network gives for goals of the train split gets one damped Gauss-Newton step on the loss;
the result is the label. Labels of the last rounds are kept, and the network is fitted to them by SOAP, in the
norm of the loss: where a change moves the end it counts. The network that is shipped is the average of the
parameters over the last steps.
"""

import copy
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

import numpy as np
import torch as th
from numpy.typing import NDArray
from torch import nn

from agents.learning.planners.soap import Soap
from space_envs.dynamics.rotations import Array

GOAL_WEIGHT = 3.0  # of the squared change of the errors in the loss, relative to that of the outputs
GRADIENT_NORM = 10.0  # largest, of a step of SOAP
WARM_UP = 50  # first rounds, in which the learning rate rises
LEAST_RATE = 0.01  # final learning rate divided by the largest
KEPT_SHARE = 0.25  # of all rounds so far, whose labels are kept at most


class Labels(NamedTuple):
    """Labels of S goals.

    Attributes:
        output: (S, n m) improved coordinates. error_by: (S, e, n m) changes of the terminal errors, weighted
            so that their squares are changes of the loss.
    """

    output: Array
    error_by: Array


class Labeller(Protocol):
    """Improves plans of numbered training goals.

    Attributes:
        features: (G, F) of all goals. longest_step: of a label from the output.
    """

    features: NDArray[np.float32]
    longest_step: float

    def __call__(self, rows: NDArray[np.int64], output: Array) -> Labels:
        """Labels of the goals in rows (S,), at the network's outputs (S, n m)."""
        ...


@dataclass(frozen=True)
class Fitting:
    """Settings of the fit.

    Attributes:
        goals: labelled in a round. rounds: in total. minibatch: labels in a step of SOAP. reuse: steps of
            SOAP in a round. memory: labels that are kept at most. learning_rate: largest. averaging: decay of
            the parameters' average, of a step.
    """

    goals: int
    rounds: int
    minibatch: int
    reuse: int
    memory: int
    learning_rate: float
    averaging: float


class SelfLabelled:
    """A network that learns from its own improved outputs.

    Args:
        network: from features to coordinates. labeller: of the training goals. seed: of the goals' order.
    """

    def __init__(self, network: nn.Module, labeller: Labeller, fitting: Fitting, seed: int) -> None:
        self.network, self._labeller, self._fitting = network, labeller, fitting
        self.average = copy.deepcopy(network).requires_grad_(False)
        self._optimizer = Soap(network.parameters(), fitting.learning_rate)
        self._rng = np.random.default_rng(seed)
        self._order = np.empty(0, dtype=np.int64)
        self._memory: dict[str, NDArray] = {}
        self._next = 0  # place of the oldest label that is kept
        self.rounds = 0

    def state(self) -> dict[str, Any]:
        """State for `restore`."""
        kept = min(self._kept(self.rounds), len(self._memory["rows"])) if self._memory else 0
        return {
            "network": self.network.state_dict(),
            "average": self.average.state_dict(),
            "optimizer": self._optimizer.state_dict(),
            "random": self._rng.bit_generator.state,
            "order": self._order,
            "memory": self._memory,
            "next": self._next,
            "kept": kept,
            "rounds": self.rounds,
        }

    def restore(self, state: dict[str, Any]) -> None:
        """Go back to a state."""
        self.network.load_state_dict(state["network"])
        self.average.load_state_dict(state["average"])
        self._optimizer.load_state_dict(state["optimizer"])
        self._rng.bit_generator.state = state["random"]
        self._order, self._memory, self._next = state["order"], dict(state["memory"]), state["next"]
        self.rounds = state["rounds"]

    def round(self) -> float:
        """Label goals, and fit; returns the mean squared length of the labels' steps."""
        rows = self._draw()
        with th.no_grad():
            output = self.network(th.from_numpy(self._labeller.features[rows])).numpy().astype(np.float64)
        labels = self._labeller(rows, output)
        step = labels.output - output
        length = np.linalg.norm(step, axis=1, keepdims=True)
        target = output + step * np.minimum(1.0, self._labeller.longest_step / np.maximum(length, 1e-12))
        self._keep(rows, target, labels.error_by)
        self._optimizer.learning_rate = self._rate()
        for minibatch in self._minibatches():
            self._fit(*minibatch)
        self.rounds += 1
        return float((length**2).mean())

    def _draw(self) -> NDArray[np.int64]:
        """Rows of the goals of a round; every goal comes once before any comes again."""
        while len(self._order) < self._fitting.goals:
            self._order = np.concatenate([self._order, self._rng.permutation(len(self._labeller.features))])
        rows, self._order = np.split(self._order, [self._fitting.goals])
        return rows

    def _kept(self, rounds: int) -> int:
        """Number of labels that are kept after so many rounds: few at first, when outputs change much."""
        f = self._fitting
        return min(f.memory, max(1, int(KEPT_SHARE * rounds)) * f.goals)

    def _keep(self, rows: NDArray[np.int64], target: Array, error_by: Array) -> None:
        """Put labels in the place of the oldest ones."""
        new = {"rows": rows, "target": target.astype(np.float32), "error_by": error_by.astype(np.float32)}
        if not self._memory or len(self._memory["rows"]) < self._kept(self.rounds + 1):
            for name, value in new.items():
                old = self._memory[name] if name in self._memory else value[:0]
                self._memory[name] = np.concatenate([old[self._next :], old[: self._next], value])
            self._next = 0
            return
        place = (self._next + np.arange(len(rows))) % len(self._memory["rows"])
        for name, value in new.items():
            self._memory[name][place] = value
        self._next = (self._next + len(rows)) % len(self._memory["rows"])

    def _minibatches(self) -> Iterator[tuple[th.Tensor, th.Tensor, th.Tensor]]:
        """Features, targets and error changes, drawn from the labels that are kept."""
        memory = self._memory
        for _ in range(self._fitting.reuse):
            chosen = self._rng.integers(len(memory["rows"]), size=self._fitting.minibatch)
            features = self._labeller.features[memory["rows"][chosen]]
            arrays = features, memory["target"][chosen], memory["error_by"][chosen]
            yield tuple(map(th.from_numpy, arrays))  # type: ignore[misc]

    def _fit(self, features: th.Tensor, target: th.Tensor, error_by: th.Tensor) -> None:
        """A step of SOAP, and of the average."""
        change = self.network(features) - target
        moved = th.bmm(error_by, change[..., None])
        loss = (change.square().sum() + GOAL_WEIGHT * moved.square().sum()) / len(features)
        self.network.zero_grad()
        loss.backward()
        nn.utils.clip_grad_norm_(self.network.parameters(), GRADIENT_NORM)
        self._optimizer.step()
        decay = min(self._fitting.averaging, 1.0 - 1.0 / (1.0 + self.rounds))
        for mean, now in zip(self.average.parameters(), self.network.parameters(), strict=True):
            mean.lerp_(now.detach(), 1.0 - decay)

    def _rate(self) -> float:
        """Learning rate: it rises first, and falls with a cosine over all rounds."""
        done = self.rounds / self._fitting.rounds
        falling = LEAST_RATE + (1.0 - LEAST_RATE) * 0.5 * (1.0 + np.cos(np.pi * min(done, 1.0)))
        return self._fitting.learning_rate * falling * min(1.0, (self.rounds + 1) / WARM_UP)
