"""A picture out of an episode, with its time."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, eq=False)
class Still:
    """What an episode looked like: `time` in s since its start, `frame` (height, width, 3)."""

    time: float
    frame: NDArray[np.uint8]
