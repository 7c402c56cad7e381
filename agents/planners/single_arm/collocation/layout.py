"""Variables of the collocation program, and how the inputs of its functions depend on them."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from agents.planners.common.splines import Mesh
from space_envs.dynamics.rotations import Array

FIXED = 2  # leading coefficients, which follow from the start angles and rates


class Layout:
    """Positions of spline coefficients and attitudes among the variables.

    The variables are the free coefficients (F, n), a coefficient's joints next to each other, then the
    attitudes (3 N) at the breaks except the first. The last two coefficients differ by a
    parameter, which follows from the end rates.
    """

    def __init__(self, mesh: Mesh, n: int) -> None:
        self.mesh, self.n, self.intervals = mesh, n, len(mesh.breaks) - 1
        self.free = mesh.size - FIXED - 1
        self.attitudes = self.free * n
        self.size = self.attitudes + 3 * self.intervals

    def coefficient(self, number: int) -> NDArray[np.int64]:
        """Variables (n,) of a coefficient, -1 where it is fixed."""
        free = min(number, self.mesh.size - 2) - FIXED
        joints = np.arange(self.n)
        return free * self.n + joints if free >= 0 else np.full(self.n, -1)

    def attitude(self, number: int) -> NDArray[np.int64]:
        """Variables (3,) of the attitude at a break, -1 where it is fixed."""
        axes = np.arange(3)
        return self.attitudes + 3 * (number - 1) + axes if number > 0 else np.full(3, -1)


@dataclass(frozen=True, eq=False)
class Inputs:
    """Inputs of a function at one point as linear combinations of variables.

    Attributes:
        variables: (inputs, width) numbers of the variables, -1 for none. factors: (inputs, width).
    """

    variables: NDArray[np.int64]
    factors: Array

    @classmethod
    def of(cls, variables: NDArray[np.int64]) -> "Inputs":
        """Inputs that are variables (inputs,) themselves."""
        return cls(variables[:, None], np.ones((len(variables), 1)))

    @classmethod
    def of_splines(cls, layout: Layout, time: float, derivatives: tuple[int, ...]) -> "Inputs":
        """Derivatives of the joint angles at a time, one after the other."""
        bases = [layout.mesh.basis(np.array([time]), k)[0] for k in derivatives]
        active = np.flatnonzero(np.any([basis != 0.0 for basis in bases], axis=0))
        variables = np.stack([layout.coefficient(int(c)) for c in active], axis=1)
        factors = np.concatenate([np.tile(basis[active], (layout.n, 1)) for basis in bases])
        return cls(np.tile(variables, (len(bases), 1)), factors)

    def joined(self, more: NDArray[np.int64]) -> "Inputs":
        """Return these inputs followed by some that are variables (m,) themselves."""
        width = self.variables.shape[1]
        variables, factors = np.full((len(more), width), -1), np.zeros((len(more), width))
        variables[:, 0], factors[:, 0] = more, 1.0
        return Inputs(np.concatenate([self.variables, variables]), np.concatenate([self.factors, factors]))

    def entries(self) -> Iterator[tuple[Any, Any, Any]]:
        """Numbers of inputs with their variables and factors, column by column, without empty ones."""
        for variable, factor in zip(self.variables.T, self.factors.T, strict=True):
            used = np.flatnonzero((variable >= 0) & (factor != 0.0))
            yield used, variable[used], factor[used]
