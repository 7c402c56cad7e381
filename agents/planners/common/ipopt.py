"""Ipopt through CasADi, with derivatives assembled by hand."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import casadi as ca

from space_envs.system.threads import ipopt_on_one_thread


@dataclass(frozen=True, eq=False)
class NonlinearProgram:
    """A nonlinear program: minimise f(x, p) with bounds on x and g(x, p).

    Attributes:
        x, p: variables and parameters, symbols. f, g: cost and constraints.
        gradient, jacobian: of f and of g by x. multipliers: symbols of f's factor and of g's multipliers.
        hessian: upper triangle of the second derivatives of the Lagrangian by x.
    """

    x: ca.MX
    p: ca.MX
    f: ca.MX
    g: ca.MX
    gradient: ca.MX
    jacobian: ca.MX
    multipliers: tuple[ca.MX, ca.MX]
    hessian: ca.MX

    def solver(self, options: Mapping[str, Any]) -> ca.Function:
        """CasADi's solver of the program, on one thread; `options` are those of `nlpsol` for Ipopt."""
        ipopt_on_one_thread()
        inputs, names = [self.x, self.p], ["x", "p"]
        grad_f = ca.Function("nlp_grad_f", inputs, [self.f, self.gradient], names, ["f", "grad_f_x"])
        jac_g = ca.Function("nlp_jac_g", inputs, [self.g, self.jacobian], names, ["g", "jac_g_x"])
        hess_lag = ca.Function(
            "nlp_hess_l",
            [*inputs, *self.multipliers],
            [self.hessian],
            [*names, "lam_f", "lam_g"],
            ["triu_hess_gamma_x_x"],
        )
        program = {"x": self.x, "p": self.p, "f": self.f, "g": self.g}
        derivatives = {"grad_f": grad_f, "jac_g": jac_g, "hess_lag": hess_lag, "no_nlp_grad": True}
        return ca.nlpsol("solver", "ipopt", program, {**derivatives, "calc_lam_p": False, **options})
