"""The finite-horizon linear-quadratic problem on the joint double integrator (eq. 12 of shyam2020), batched.

State x = [q - goal; qdot], control u = joint accelerations held over a control period. Eq. 12 is
read as a sum over control periods, with a Riccati recursion and a terminal weight from the algebraic Riccati
equation.
"""

import numpy as np
from scipy.linalg import solve_discrete_are

from space_envs.dynamics.rotations import Array

# Q_t = (t / T)^RAMP Q. Constant weights demand all the acceleration in the first instant; with increasing
# weights the arm accelerates gently and is still at rest at T, up to 1e-4 of the displacement (policy `mpc`).
RAMP = 10.0


def double_integrator(n: int, dt: float) -> tuple[Array, Array]:
    """System matrices A (2 n, 2 n) and B (2 n, n) of n joints with accelerations held over dt (s)."""
    unit = np.eye(n)
    a = np.block([[unit, dt * unit], [np.zeros((n, n)), unit]])
    return a, np.concatenate([0.5 * dt**2 * unit, dt * unit])


def terminal_weight(a: Array, b: Array, q: Array, r: Array) -> Array:
    """Solution P (..., m, m) of the algebraic Riccati equation for weights q (..., m, m), r (..., k, k)."""
    m, k = b.shape
    flat = [
        solve_discrete_are(a, b, x, y) for x, y in zip(q.reshape(-1, m, m), r.reshape(-1, k, k), strict=True)
    ]
    return np.array(flat).reshape(q.shape)


def riccati_step(a: Array, b: Array, q: Array, r: Array, p: Array) -> tuple[Array, Array]:
    """Gain K (..., k, m), u = -K x, and cost-to-go P (..., m, m) one step before the cost-to-go p."""
    projected = b.T @ p
    gain = np.linalg.solve(r + projected @ b, projected @ a)
    before = q + a.T @ p @ (a - b @ gain)
    return gain, 0.5 * (before + before.swapaxes(-1, -2))


def receding_gains(q: Array, r: Array, times: Array, ramp: Array | float = RAMP) -> tuple[Array, Array]:
    """Gains of the receding-horizon controller at every control step of a motion.

    The horizon of every step is the duration of the motion, with weights (t / T)^ramp Q and R that stay at Q
    and R beyond T, and with P of the algebraic Riccati equation for those as terminal weight. P is the fixed
    point of the recursion beyond T, so that all steps share one backward pass.

    Args:
        q: (..., 2 n, 2 n). r: (..., n, n), positive definite. times: (T,) s, the last being the duration.
        ramp: exponents (...,).

    Returns:
        Gains (T, ..., n, 2 n), the last being the one for all times from T on, and costs-to-go
        (T, ..., 2 n, 2 n).
    """
    a, b = double_integrator(r.shape[-1], float(times[1] - times[0]))
    cost = terminal_weight(a, b, q, r)
    gains, costs = [riccati_step(a, b, q, r, cost)[0]], [cost]
    for phase in times[-2::-1] / times[-1]:
        share = np.asarray(phase ** np.asarray(ramp))[..., None, None]
        gain, cost = riccati_step(a, b, share * q, r, cost)
        gains.append(gain)
        costs.append(cost)
    return np.stack(gains[::-1]), np.stack(costs[::-1])


def closed_loop(gains: Array, dt: float, disturbance: Array | None = None) -> tuple[Array, Array]:
    """Trajectories of the controlled system: x_t = transition_t x_0 + response_t.

    Args:
        gains: (T, ..., n, 2 n). dt: s. disturbance: (T, ..., n) accelerations in addition to the control,
            rad/s^2; None for none.

    Returns:
        Transitions (T, ..., 2 n, 2 n) and responses (T, ..., 2 n) to the disturbance.
    """
    n, m = gains.shape[-2:]
    a, b = double_integrator(n, dt)
    transitions = np.empty((*gains.shape[:-2], m, m))
    responses = np.zeros((*gains.shape[:-2], m))
    transitions[0] = np.eye(m)
    for t in range(len(gains) - 1):
        step = a - b @ gains[t]
        transitions[t + 1] = step @ transitions[t]
        if disturbance is not None:
            carried = (step @ responses[t][..., None])[..., 0]
            responses[t + 1] = carried + (b @ disturbance[t][..., None])[..., 0]
    return transitions, responses
