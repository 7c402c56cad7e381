"""Joint drives: torques that track rate commands within torque, rate and position limits, batched."""

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from space_envs.dynamics.rotations import Array
from space_envs.robots.control_laws import ControlLaws
from space_envs.robots.models.accelerations import reduced_masses
from space_envs.robots.robot import Robot
from space_envs.simulation import Simulation

BRAKING_RATIO = 0.16  # of a joint's acceleration limit, at which it brakes before the end of its range
BRAKING_TORQUE = 0.8  # of a drive's torque, which braking of all joints takes at most in an arm at rest
CORIOLIS_SHARE = 0.4  # of a drive's torque; the arm is slowed if Coriolis forces need more
CORIOLIS_LOST = 0.8  # of a drive's torque; Coriolis forces are not compensated if they need more
OVERSPEED = 1.05  # times the rate limit; the arm is slowed beyond it
BRAKING_SHARE = 0.2  # of a drive's torque; starts that need more to brake all joints together are rejected
STOP_MARGIN = 0.1  # rad; the drives stop joints this far inside their ranges


@lru_cache(maxsize=64)
def braking_deceleration(robot: Robot) -> Array:
    """Deceleration (n,) of joints approaching the ends of their ranges, rad/s^2, read-only.

    It is a share of their acceleration limits, or less where the torques of the drives could not brake all
    joints at once.
    """
    deceleration = BRAKING_RATIO * robot.acceleration_limit
    room = (robot.torque_limit / (np.abs(reduced_masses(robot)) @ deceleration)).min()
    deceleration = min(1.0, BRAKING_TORQUE * float(room)) * deceleration
    deceleration.setflags(write=False)
    return deceleration


def braking_rates(robot: Robot, room: Array) -> Array:
    """Braking law: the largest rates (..., n), rad/s, from which joints stop within angles (..., n).

    Args:
        robot: whose limits they do not exceed. room: rad, at least 0.
    """
    return np.minimum(np.sqrt(2.0 * braking_deceleration(robot) * room), robot.rate_limit)


class JointStops:
    """Ends of a robot's joint ranges, and the rates from which joints brake before them."""

    def __init__(self, robot: Robot) -> None:
        # Distance to the lower and the upper stop is offset + sign * angle, (2, n).
        self._sign = np.array([[1.0], [-1.0]])
        self._offset = -self._sign * robot.joint_range.T - STOP_MARGIN
        self._twice, self._fastest = 2.0 * braking_deceleration(robot), robot.rate_limit

    def room(self, position: Array) -> Array:
        """Angle (N, 2, n), rad, to the lower and the upper stop at joint angles (N, n), rad."""
        return np.maximum(self._offset + self._sign * position[:, None, :], 0.0)

    def rates(self, position: Array) -> tuple[Array, Array]:
        """Least and largest rate (N, n), rad/s, at joint angles (N, n), rad."""
        fastest = np.minimum(np.sqrt(self._twice * self.room(position)), self._fastest)
        return -fastest[:, 0], fastest[:, 1].copy()


def braking_shares(simulation: Simulation, stops: JointStops) -> Array:
    """Share (N, n) of each drive's torque needed to brake the present joint rates before their stops.

    Every joint decelerates uniformly to the end of its range, less the margin. The torque is the sum of
    |M* a| and |h*|, the Coriolis and centrifugal part. Both are quadratic in the rates.
    """
    velocity, room = simulation.joint_velocity, stops.room(simulation.joint_position)
    ahead = np.where(velocity > 0.0, room[:, 1], room[:, 0])
    deceleration = -0.5 * velocity * np.abs(velocity) / np.maximum(ahead, 1e-9)
    mass, bias, b = simulation.mass_matrix(), simulation.bias(), simulation.n_base
    force = np.stack([(mass[:, :, b:] @ deceleration[..., None])[..., 0], bias], axis=-1)
    torque = force[:, b:] - mass[:, b:, :b] @ np.linalg.solve(mass[:, :b, :b], force[:, :b])
    return np.abs(torque).sum(axis=-1) / simulation.model.actuator_forcerange[:, 1]


class Drive:
    """Joint drives: rate commands to torques, within torque, rate and position limits.

    The servo is a computed torque held over the control period Tc: with the base eliminated through
    momentum, tau = M* (commanded rate - rate) / Tc + h*, so the commanded rate is reached at the end of the
    period. M and the bias forces are extrapolated to the middle of the period from their last two values,
    which makes the servo second order where the motion is smooth. Where a torque limit binds, the change of
    rate is scaled as a whole and keeps its direction.
    """

    def __init__(self, simulation: Simulation, control_period: float, robot: Robot) -> None:
        self.simulation = simulation
        self.control_period = control_period
        self.rate_limit = robot.rate_limit
        self.acceleration_limit = robot.acceleration_limit
        self.torque_limit = robot.torque_limit
        self._fastest = OVERSPEED * self.rate_limit
        self._stops = JointStops(robot)
        self.extrapolate = True
        self._b = simulation.n_base
        self.laws = self.laws_of(self.rate_limit, self.rate_limit)
        self._last_mass = np.zeros_like(simulation.mass_entries)
        self._last_bias = np.zeros_like(simulation.bias())

    _mass: Array  # (N, b + n, b + n) and (N, b + n) of the period
    _bias: Array
    low: Array  # (N, n) least and largest rate, rad/s, from which each joint can still brake before its limit
    high: Array
    late: NDArray[np.bool_]  # (N, n) whether its rate is not between them

    def laws_of(
        self, rates: Array, scale: Array, gain: float = 0.0, regularisation: float = 0.0
    ) -> ControlLaws:
        """Compiled laws of these drives; arguments as of `ControlLaws`."""
        coriolis = CORIOLIS_SHARE, CORIOLIS_LOST
        limits = self.torque_limit, self._fastest, self.acceleration_limit
        return ControlLaws(
            self.control_period, self._b, coriolis, *limits, rates, scale, gain, regularisation
        )

    def reset(self, rows: NDArray[np.int64]) -> None:
        """Reset the extrapolation of rows (k,) whose state was set."""
        self._last_mass[rows] = self.simulation.mass_entries[rows]
        self._last_bias[rows] = self.simulation.bias()[rows]

    def begin(self) -> None:
        """Update to the state at the start of a control period; call once per period, before the torques."""
        self.low, self.high = self._stops.rates(self.simulation.joint_position)
        now = self.simulation.joint_velocity
        self.late = (now < self.low) | (now > self.high)
        mass, bias = self.simulation.mass_entries, self.simulation.bias()
        if self.extrapolate:
            mass, bias = _middle(mass, self._last_mass), _middle(bias, self._last_bias)
        self._mass, self._bias = self.simulation.dense(mass), np.ascontiguousarray(bias)

    def snapshot(self) -> tuple[Array, Array]:
        """Entries of the mass matrix and bias forces of the last period, copies."""
        return self._last_mass.copy(), self._last_bias.copy()

    def restore(self, snapshot: tuple[Array, Array]) -> None:
        """Restore a snapshot."""
        self._last_mass, self._last_bias = snapshot[0].copy(), snapshot[1].copy()

    def track(self, rate: Array) -> Array:
        """Torques (N, n), N m, that reach joint rates (N, n), rad/s, at the end of the control period.

        Each joint's acceleration is limited on its own.
        """
        acceleration = np.minimum(np.maximum(rate, self.low), self.high) - self.simulation.joint_velocity
        acceleration /= self.control_period
        limit = self.acceleration_limit
        return self.accelerate(np.minimum(np.maximum(acceleration, -limit), limit))

    def accelerate(self, acceleration: Array) -> Array:
        """Torques (N, n) for joint accelerations (N, n) that respect every limit but the torque's: M* a + h*.

        The acceleration is scaled so that every torque is within its limit. Joints that are too fast to
        stop before their limit brake first, and the others change with the remaining torque.
        """
        now = self.simulation.joint_velocity
        if self.laws.compiled:
            return self.laws.accelerate(self._mass, self._bias, now, acceleration, self.late)
        # Products of two columns: those of one column have other last bits.
        inertial = self._mass[:, :, self._b :] @ acceleration[..., None].repeat(2, axis=2)
        inertial[..., 1] = self._bias
        need, held = self._eliminated(self._mass, inertial)
        torque = held + need
        load = np.abs(held) / self.torque_limit
        fast = (load > CORIOLIS_SHARE) | (np.abs(now) > self._fastest)
        limited = self.late | fast | (np.abs(torque) > self.torque_limit)
        if not limited.any():
            return torque
        rows = np.flatnonzero(limited.any(axis=1)) if len(torque) > 1 else slice(None)
        torque[rows] = self._limited(rows, acceleration[rows], need[rows], held[rows], load[rows], fast[rows])
        return torque

    def _eliminated(self, mass: Array, force: Array) -> tuple[Array, Array]:
        """Joint torques (k, n) for each of two generalised forces (k, b + n, 2): the base has none."""
        b = self._b
        torque = force[:, b:] - mass[:, b:, :b] @ np.linalg.solve(mass[:, :b, :b], force[:, :b])
        return torque[..., 0], torque[..., 1]

    def _limited(
        self,
        rows: NDArray[np.int64] | slice,
        acceleration: Array,
        need: Array,
        held: Array,
        load: Array,
        fast: NDArray[np.bool_],
    ) -> Array:
        """Torques (k, n) of rows (k,) within their limits.

        Args:
            need, held: torques (k, n) for accelerations (k, n), and for Coriolis and centrifugal forces.
            load: (k, n) share of a drive's torque in `held`. fast: (k, n) whether it slows the arm.
        """
        late = self.late[rows]
        if not (late.any() or fast.any()):
            return self._within(held + need * self._room(held, need))
        stop = self.simulation.joint_velocity[rows] * (-1.0 / self.control_period)
        mass, command = self._mass[rows], np.stack([acceleration * late, stop], axis=2)
        braking, stopping = self._eliminated(mass, mass[:, :, self._b :] @ command)
        after = held + braking * self._room(held, braking)
        rest = need - braking
        torque = after + rest * self._room(after, rest)
        # If Coriolis forces need much of a drive's torque, the whole arm is slowed along its direction of
        # motion. If they need nearly all of it, they are not compensated: they do no work, so torques opposed
        # to M* times the rates always brake.
        retained = np.where(load.max(axis=1, keepdims=True) > CORIOLIS_LOST, 0.0, held)
        slower = retained + stopping * self._room(retained, stopping)
        return self._within(np.where(fast.any(axis=1, keepdims=True), slower, torque))

    def _room(self, held: Array, need: Array) -> Array:
        """Largest factor (N, 1) up to 1 with which `need` can be added to `held` within the torque limits."""
        room = np.maximum(self.torque_limit - held * np.sign(need), 0.0)
        return np.minimum((room / np.maximum(np.abs(need), 1e-9)).min(axis=1, keepdims=True), 1.0)

    def _within(self, torque: Array) -> Array:
        return np.minimum(np.maximum(torque, -self.torque_limit), self.torque_limit)

    def protect(self, torque: Array) -> Array:
        """Commanded torques (N, n), replaced in rows where they would violate a rate or position limit."""
        torque = self._within(torque)
        acceleration = self._forward(torque)
        rate = self.simulation.joint_velocity + self.control_period * acceleration
        # Faster changes cannot be controlled by a torque that is constant over the period.
        harsh = np.abs(acceleration) > 0.5 * self.rate_limit / self.control_period
        violated = np.any((rate < self.low) | (rate > self.high) | harsh, axis=1)
        if not violated.any():
            return torque
        return np.where(violated[:, None], self.track(rate), torque)

    def _forward(self, torque: Array) -> Array:
        """Joint accelerations (N, n) for torques (N, n)."""
        if self.laws.compiled:
            return self.laws.forward(self._mass, self._bias, torque)
        force = -self._bias
        force[:, self._b :] += torque
        return np.linalg.solve(self._mass, force[..., None])[:, self._b :, 0]


def _middle(now: Array, last: Array) -> Array:
    """Values in the middle of a period, extrapolated from those at its start and at the last one's, which
    then are the present ones."""
    middle = 1.5 * now
    last *= 0.5
    middle -= last
    last[:] = now
    return middle
