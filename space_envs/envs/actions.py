"""Validation of actions: an array in [-1, 1] of the expected shape, or an error."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from space_envs.dynamics.rotations import Array
from space_envs.errors import ActionError


def action_array(action: Any) -> NDArray:
    """`action` as an array.

    Raises:
        ActionError: if it cannot be converted.
    """
    try:
        return np.asarray(action)
    except Exception as error:  # a user's object may raise anything
        raise ActionError(f"action must be an array of numbers: {error}") from None


def checked_actions(actions: Any, shape: tuple[int, int]) -> tuple[Array, NDArray[np.bool_] | None]:
    """Actions (N, m) as float64, clipped to [-1, 1], and the mask (N,) of clipped rows; None if there are
    none.

    Raises:
        ActionError: for another shape or type, NaN or infinity.
    """
    action = action_array(actions)
    if action.shape != shape:
        raise ActionError(f"action must have shape {shape}, got {action.shape}")
    if action.dtype.kind not in "fiu":
        raise ActionError(f"action must be real numbers, got dtype {action.dtype}")
    action = action.astype(np.float64)
    inside = np.minimum(np.maximum(action, -1.0), 1.0)
    # One comparison finds clipped values and NaN; infinity is among the clipped ones.
    changed = inside != action
    if not changed.any():
        return inside, None
    if not np.isfinite(action).all():
        rows = np.flatnonzero(~np.isfinite(action).all(axis=1)).tolist()
        raise ActionError(f"action holds NaN or infinity in rows {rows}")
    return inside, changed.any(axis=1)
