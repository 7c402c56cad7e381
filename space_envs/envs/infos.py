"""Infos of the vector environment: an array for each key, and with a leading underscore the rows it is of."""

from typing import Any

import numpy as np
from numpy.typing import NDArray


def masked(info: dict[str, Any], rows: NDArray[np.bool_]) -> dict[str, Any]:
    """A copy of a vector info, present in `rows` only."""
    return {
        key: rows.copy()
        if key.startswith("_")
        else masked(value, rows)
        if isinstance(value, dict)
        else value.copy()
        for key, value in info.items()
    }


def first_row(info: dict[str, Any]) -> dict[str, Any]:
    """Row 0 of a vector info, without its presence masks, as plain Python values."""
    return {
        key: first_row(value) if isinstance(value, dict) else value.item(0)
        for key, value in info.items()
        if not key.startswith("_")
    }
