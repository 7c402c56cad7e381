"""A multilayer perceptron in numpy: what a learned policy needs to act, without a learning library.

Each row is a matrix product of its own, so that the result for an observation depends neither on how many
others are evaluated with it nor on its place among them. In a product of several rows it can: some kernels of
OpenBLAS sum the columns at the edge of a block in another order.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import erf, expit

from space_envs.errors import PolicyError, unknown_name

Floats = NDArray[np.float32]
# As torch computes them, with its default parameters.
ACTIVATIONS: dict[str, Callable[[Floats], Floats]] = {
    "tanh": np.tanh,
    "relu": lambda x: np.maximum(x, 0.0),
    "leaky_relu": lambda x: np.where(x > 0.0, x, 0.01 * x),
    "elu": lambda x: np.where(x > 0.0, x, np.expm1(np.minimum(x, 0.0))),
    "silu": lambda x: x * expit(x),
    "gelu": lambda x: 0.5 * x * (1.0 + erf(x / 2.0**0.5)),
}
LOG_DEVIATION = (-20.0, 2.0)  # bounds, those of stable-baselines3's SAC


@dataclass(frozen=True, eq=False)
class Network:
    """Gaussian policy: mean and log standard deviation of actions from features.

    Attributes:
        weights, biases: of the hidden layers and of the mean, (in, out) and (out,), float32.
        deviation_weight, deviation_bias: (last hidden, m) and (m,), the log standard deviation's layer.
        activation: of the hidden layers, one of `ACTIVATIONS`.
        squash: whether an action is the tanh of its Gaussian variable (SAC, TD3) or clipped (PPO).
    """

    weights: tuple[Floats, ...]
    biases: tuple[Floats, ...]
    deviation_weight: Floats
    deviation_bias: Floats
    activation: str
    squash: bool

    def __post_init__(self) -> None:
        if self.activation not in ACTIVATIONS:
            raise unknown_name("activation", self.activation, ACTIVATIONS)
        if not self.weights or len(self.weights) != len(self.biases):
            raise PolicyError("a network needs as many weight matrices as bias vectors, at least one")
        layers = [*zip(self.weights, self.biases, strict=True), (self.deviation_weight, self.deviation_bias)]
        inputs = [self.weights[0].shape[0], *(len(b) for b in self.biases[:-1])]
        inputs.append(inputs[-1])
        for (weight, bias), size in zip(layers, inputs, strict=True):
            if weight.shape != (size, *bias.shape) or bias.ndim != 1:
                raise PolicyError(
                    f"layers do not fit: weight {weight.shape}, bias {bias.shape}, input {size}"
                )
            if not (np.isfinite(weight).all() and np.isfinite(bias).all()):
                raise PolicyError("a network's parameters must be finite")
        if self.deviation_bias.shape != self.biases[-1].shape:
            raise PolicyError("mean and deviation must have the same size")

    @property
    def inputs(self) -> int:
        """Number of features."""
        return self.weights[0].shape[0]

    @property
    def outputs(self) -> int:
        """Number of actions."""
        return len(self.biases[-1])

    def means(self, features: NDArray) -> Floats:
        """Outputs (N, m) of the last layer for features (N, F), without bounds."""
        return self._mean(self._hidden(features))

    def actions(self, features: NDArray, generator: np.random.Generator | None = None) -> Floats:
        """Actions (N, m) in [-1, 1] for features (N, F); drawn from the policy where a generator is given."""
        x = self._hidden(features)
        mean = self._mean(x)
        if generator is not None:
            log = (x @ self.deviation_weight + self.deviation_bias)[:, 0]
            noise = generator.standard_normal(mean.shape, dtype=np.float32)
            mean = mean + np.exp(np.clip(log, *LOG_DEVIATION)) * noise
        return np.tanh(mean) if self.squash else np.clip(mean, -1.0, 1.0)

    def _hidden(self, features: NDArray) -> Floats:
        """Outputs (N, 1, h) of the last hidden layer."""
        x = np.ascontiguousarray(features, dtype=np.float32)[:, None, :]
        for weight, bias in zip(self.weights[:-1], self.biases[:-1], strict=True):
            x = ACTIVATIONS[self.activation](x @ weight + bias)
        return x

    def _mean(self, x: Floats) -> Floats:
        return (x @ self.weights[-1] + self.biases[-1])[:, 0]
