"""Functions with first and second derivatives, as CasADi functions."""

from collections.abc import Mapping
from dataclasses import dataclass

import casadi as ca


@dataclass(frozen=True, eq=False)
class Smooth:
    """A function f(q, qdot, *parameters) of k outputs with its derivatives by y = [q; qdot].

    Attributes:
        value: -> f (k). slope: -> df/dy (k, 2 n). bend: (q, qdot, *parameters, weight (k)) -> second
            derivative (2 n, 2 n) of weight' f.
    """

    value: ca.Function
    slope: ca.Function
    bend: ca.Function

    @classmethod
    def named(cls, functions: Mapping[str, ca.Function], name: str) -> "Smooth":
        """The three functions of `smooth_parts` with this name."""
        return cls(*(functions[f"{name}_{part}"] for part in ("value", "slope", "bend")))


def smooth_parts(name: str, f: ca.SX, of: list[ca.SX], parameters: list[ca.SX]) -> dict[str, ca.Function]:
    """The three functions of a `Smooth`, by name."""
    y, weight = ca.vertcat(*of), ca.SX.sym("weight", f.numel())
    bend = ca.hessian(ca.dot(weight, f), y)[0]
    outputs = {"value": f, "slope": ca.jacobian(f, y), "bend": bend}
    extra = {"value": [], "slope": [], "bend": [weight]}
    return {
        f"{name}_{part}": ca.Function(
            f"{name}_{part}", [*of, *parameters, *extra[part]], ca.cse([ca.densify(value)])
        )
        for part, value in outputs.items()
    }
