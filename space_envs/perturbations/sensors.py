"""Noise and bias of sensors: independent errors of every component that an observation is computed from."""

from typing import NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from space_envs.dynamics.rotations import Array, exponential, multiply
from space_envs.perturbations.draws import NOISE_BLOCK, Stream, generator


class SensorError(NamedTuple):
    """Standard deviation of a kind of sensor at the factor 1, with its unit."""

    name: str
    deviation: float
    unit: str


# About those of joint encoders, star tracker and gyroscope, and cameras at close range.
ATTITUDE_ERROR = SensorError("attitude of the satellite, about each axis", 1e-4, "rad")
SENSOR_ERRORS = {
    mujoco.mjtSensor.mjSENS_JOINTPOS: SensorError("angles of joints", 5e-4, "rad"),
    mujoco.mjtSensor.mjSENS_JOINTVEL: SensorError("rates of joints", 5e-4, "rad/s"),
    mujoco.mjtSensor.mjSENS_FRAMEPOS: SensorError("positions", 1e-3, "m"),
    mujoco.mjtSensor.mjSENS_FRAMEQUAT: SensorError("orientations, about each axis", 1e-3, "rad"),
    mujoco.mjtSensor.mjSENS_FRAMEZAXIS: SensorError("directions, about each axis", 1e-3, "rad"),
    mujoco.mjtSensor.mjSENS_FRAMELINVEL: SensorError("linear velocities", 1e-3, "m/s"),
    mujoco.mjtSensor.mjSENS_FRAMEANGVEL: SensorError("angular velocities", 5e-4, "rad/s"),
}
_QUATERNION = int(mujoco.mjtSensor.mjSENS_FRAMEQUAT)
_ANGLE = int(mujoco.mjtSensor.mjSENS_JOINTPOS)
_SITE = int(mujoco.mjtObj.mjOBJ_SITE)
_DIRECTION = int(mujoco.mjtSensor.mjSENS_FRAMEZAXIS)


class SensorErrors:
    """Noise and bias of the sensors of N episodes.

    Sensors of other types than those of `SENSOR_ERRORS` have none. Orientations and directions are rotated by
    small random angles. A component that is zero by the plane's symmetry may not be zero when measured.

    Args:
        model: with s numbers of sensors. n: N. noise, bias: factors on the standard deviations.
    """

    def __init__(self, model: mujoco.MjModel, n: int, noise: float, bias: float) -> None:
        self._noise, self._bias = noise, bias
        kinds = {int(kind): error.deviation for kind, error in SENSOR_ERRORS.items()}
        self._deviation = np.zeros(model.nsensordata)
        attitude = {model.sensor(name).adr.item() for name in _attitude_sensors(model)}
        self._quaternions: list[slice] = []
        self._directions: list[slice] = []
        for kind, start, size in zip(model.sensor_type, model.sensor_adr, model.sensor_dim, strict=True):
            columns = slice(int(start), int(start) + int(size))
            own = columns.start in attitude
            self._deviation[columns] = ATTITUDE_ERROR.deviation if own else kinds.get(int(kind), 0.0)
            if int(kind) == _QUATERNION:
                self._quaternions.append(columns)
            elif int(kind) == _DIRECTION:
                self._directions.append(columns)
        self._keys: NDArray[np.int64] = np.zeros((n, 2), dtype=np.int64)
        self._offset = np.zeros((n, model.nsensordata))
        self._block = np.full(n, -1)
        self._drawn = np.zeros((n, NOISE_BLOCK if noise else 0, model.nsensordata))

    def begin(self, rows: NDArray[np.int64], keys: NDArray[np.int64]) -> None:
        """Draw the biases of new episodes in rows (k,) with keys (k, 2)."""
        self._keys[rows], self._block[rows] = keys, -1
        if self._bias:
            for row, key in zip(rows, keys, strict=True):
                drawn = generator(key, Stream.BIAS).standard_normal(len(self._deviation))
                self._offset[row] = self._bias * self._deviation * drawn

    def measured(self, sensors: Array, steps: NDArray[np.int64], rows: NDArray[np.int64]) -> Array:
        """Measurements (k, s) of sensors (k, s) of rows (k,) after steps (k,) of their episodes."""
        error = self._offset[rows]
        if self._noise:
            error += self._noise_of(steps, rows)
        out = sensors + error
        for at in self._quaternions:
            # A small rotation of the measured frame; the fourth number of its error is not used.
            out[:, at] = multiply(exponential(error[:, at][:, :3]), sensors[:, at])
        for at in self._directions:
            tilted = sensors[:, at] + np.cross(error[:, at], sensors[:, at])
            out[:, at] = tilted / np.linalg.norm(tilted, axis=1, keepdims=True)
        return out

    def _noise_of(self, steps: NDArray[np.int64], rows: NDArray[np.int64]) -> Array:
        """Noise (k, s) of rows (k,) after steps (k,), drawn block by block."""
        block, place = np.divmod(steps, NOISE_BLOCK)
        for row, number in zip(rows, block, strict=True):
            if number != self._block[row]:
                random = generator(self._keys[row], Stream.NOISE, int(number))
                drawn = random.standard_normal(self._drawn.shape[1:])
                self._drawn[row], self._block[row] = self._noise * self._deviation * drawn, number
        return self._drawn[rows, place]

    def snapshot(self) -> dict[str, NDArray]:
        """State for `restore`: keys and biases; noise is drawn again."""
        return {"keys": self._keys.copy(), "offset": self._offset.copy()}

    def restore(self, snapshot: dict[str, NDArray]) -> None:
        """Continue from a snapshot of as many episodes."""
        self._keys, self._offset = snapshot["keys"].copy(), snapshot["offset"].copy()
        self._block[:] = -1


def _attitude_sensors(model: mujoco.MjModel) -> list[str]:
    """Names of the sensors of the base's attitude: a quaternion in space, an angle in the plane."""
    base, found = int(model.jnt_bodyid[0]), []
    for number in range(model.nsensor):
        kind, thing = int(model.sensor_type[number]), int(model.sensor_objid[number])
        if kind == _ANGLE:
            body = int(model.jnt_bodyid[thing])
        elif kind == _QUATERNION:
            site = int(model.sensor_objtype[number]) == _SITE
            body = int(model.site_bodyid[thing]) if site else thing
        else:
            continue
        if body == base:
            found.append(model.sensor(number).name)
    return found
