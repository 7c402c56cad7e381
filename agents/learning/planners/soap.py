"""SOAP: Adam in the eigenbasis of Shampoo's preconditioner (Vyas et al. 2024)."""

from collections.abc import Iterable
from typing import Any

import torch as th

BETA_GRADIENT, BETA_SQUARE = 0.95, 0.95  # decay of the averages of gradients, their squares and products
EPSILON = 1e-8
EVERY = 10  # steps between two updates of the eigenbases


class Soap:
    """Optimiser of a network's matrices and vectors; vectors get Adam's step.

    Gauss-Newton labels weigh some directions of the output a thousand times more than others. Adam scales
    each parameter alone, which does not help against that; in the eigenbasis it does.

    Attributes:
        learning_rate: of the next step.
    """

    def __init__(self, parameters: Iterable[th.nn.Parameter], learning_rate: float) -> None:
        self.learning_rate = learning_rate
        self._parameters = list(parameters)
        self._steps = 0
        self._state: list[dict[str, th.Tensor]] = [_initial(each) for each in self._parameters]

    def state_dict(self) -> dict[str, Any]:
        """State for `load_state_dict`."""
        return {"steps": self._steps, "tensors": self._state}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Go back to a state."""
        self._steps = state["steps"]
        self._state = [{name: x.clone() for name, x in each.items()} for each in state["tensors"]]

    @th.no_grad()
    def step(self) -> None:
        """Change the parameters by their gradients."""
        self._steps += 1
        for parameter, state in zip(self._parameters, self._state, strict=True):
            if (gradient := parameter.grad) is None:
                continue
            state["mean"].lerp_(gradient, 1.0 - BETA_GRADIENT)
            if gradient.ndim == 2:
                self._update_bases(gradient, state)
            projected = _into(gradient, state)
            state["square"].lerp_(projected * projected, 1.0 - BETA_SQUARE)
            if self._steps == 1:
                continue  # the bases are known from now on
            root = (state["square"] / (1.0 - BETA_SQUARE**self._steps)).sqrt_().add_(EPSILON)
            mean = _into(state["mean"], state) / (1.0 - BETA_GRADIENT**self._steps)
            parameter.sub_(_out_of(mean / root, state), alpha=self.learning_rate)

    def _update_bases(self, gradient: th.Tensor, state: dict[str, th.Tensor]) -> None:
        state["left"].lerp_(gradient @ gradient.T, 1.0 - BETA_SQUARE)
        state["right"].lerp_(gradient.T @ gradient, 1.0 - BETA_SQUARE)
        if self._steps == 1:
            for side in ("left", "right"):
                state[f"{side}_basis"] = th.linalg.eigh(state[side])[1].flip(1)
        elif self._steps % EVERY == 0:
            for side in ("left", "right"):
                state[f"{side}_basis"] = th.linalg.qr(state[side] @ state[f"{side}_basis"])[0]


def _initial(parameter: th.nn.Parameter) -> dict[str, th.Tensor]:
    state = {"mean": th.zeros_like(parameter.data), "square": th.zeros_like(parameter.data)}
    if parameter.ndim == 2:
        for side, size in zip(("left", "right"), parameter.shape, strict=True):
            state[side] = th.zeros(size, size)
            state[f"{side}_basis"] = th.eye(size)
    return state


def _into(x: th.Tensor, state: dict[str, th.Tensor]) -> th.Tensor:
    return state["left_basis"].T @ x @ state["right_basis"] if x.ndim == 2 else x


def _out_of(x: th.Tensor, state: dict[str, th.Tensor]) -> th.Tensor:
    return state["left_basis"] @ x @ state["right_basis"].T if x.ndim == 2 else x
