"""The few capsules that enclose the many shapes of a link."""

from collections.abc import Sequence
from itertools import combinations

import numpy as np

from space_envs.dynamics.rotations import Array
from space_envs.robots.description.shape.clouds import Cloud, joined, thinned
from space_envs.robots.description.shape.enclosing import Segment, enclosing_capsule

_MOST = 3  # capsules of a link
_WORTH = 1.3  # joined volume over the sum of volumes, up to which two capsules become one
_COMPARED = 6  # shapes whose capsules are fitted in pairs
_ROUGH = 1  # rounds of fits that are only compared


def link_capsules(clouds: Sequence[Cloud]) -> list[Segment]:
    """Capsules that enclose all geometry of a link, fewer where that costs little volume."""
    groups = _gathered(clouds)
    few = [thinned(group) for group in groups]
    volumes: dict[tuple[int, ...], float] = {
        (number,): enclosing_capsule(cloud, _ROUGH).volume for number, cloud in enumerate(few)
    }
    parts = list(volumes)
    while len(parts) > 1:
        pairs = [(one + other, one, other) for one, other in combinations(parts, 2)]
        for whole, _, _ in pairs:
            if whole not in volumes:
                volumes[whole] = enclosing_capsule(joined([few[number] for number in whole]), _ROUGH).volume
        growth = [volumes[whole] / (volumes[one] + volumes[other]) for whole, one, other in pairs]
        least = int(np.argmin(growth))
        if growth[least] > _WORTH and len(parts) <= _MOST:
            break
        whole, one, other = pairs[least]
        parts = [*(part for part in parts if part not in (one, other)), whole]
    return [enclosing_capsule(joined([groups[number] for number in part])) for part in parts]


def _gathered(clouds: Sequence[Cloud]) -> list[Cloud]:
    """At most `_COMPARED` clouds: those nearest to each other are joined, such as the links of a hand."""
    groups = list(clouds)
    while len(groups) > _COMPARED:
        middles = np.array([_middle(group) for group in groups])
        one, other = min(
            combinations(range(len(groups)), 2),
            key=lambda pair: float(np.linalg.norm(middles[pair[0]] - middles[pair[1]])),
        )
        whole = joined([groups[one], groups[other]])
        groups = [*(group for place, group in enumerate(groups) if place not in (one, other)), whole]
    return groups


def _middle(cloud: Cloud) -> Array:
    return (cloud.centres.min(axis=0) + cloud.centres.max(axis=0)) / 2
