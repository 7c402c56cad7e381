"""Whether planned joint motions touch the satellite, the target or the other arm: what policies check with.

By the same distances by which the simulation ends an episode; a plan keeps a little farther away.
"""

from collections.abc import Sequence

import numpy as np

from agents.planning import Cause, Failure
from space_envs.dynamics import FloatingRobot
from space_envs.dynamics.rotations import Array
from space_envs.tasks.contacts import Contacts

MARGIN = 0.002  # m, that a plan keeps beyond what the simulation asks for, for its drives' errors
COARSE = 5


def least_gaps(contacts: Contacts, arm: FloatingRobot, path: Array) -> Array:
    """Least gap (...) in m between the satellite and the arms along joint motions (..., T, n) rad.

    How the satellite moves meanwhile does not matter: the gap depends on the joint angles alone.
    """
    return contacts.satellite_gaps(contacts.points(arm, path)).min(axis=(-1, -2, -3))


def touching(
    method: str, contacts: Contacts | None, arm: FloatingRobot, times: Array, path: Array
) -> Failure | None:
    """Why a joint motion (T, n) rad at times (T,) s is no plan: a link in the satellite. Otherwise None."""
    if contacts is None or contacts.shape.half is None:
        return None
    gaps = contacts.satellite_gaps(contacts.points(arm, path))
    if gaps.min() > MARGIN:
        return None
    node, _, place = np.unravel_index(gaps.argmin(), gaps.shape)
    reason = (
        f"link {contacts.shape.link[place]} would be {gaps.min():.3f} m from the satellite at t = "
        f"{times[node]:.2f} s"
    )
    return Failure(method, Cause.CLEARANCE, reason)


def first_clear(contacts: Contacts, arm: FloatingRobot, paths: Array, order: Sequence[int]) -> int | None:
    """The first of motions (K, T, n) rad, in an order, that is clear of the satellite, if there is one.

    Looked at on every `COARSE`-th sample: to choose by, not to be sure.
    """
    return next((k for k in order if least_gaps(contacts, arm, paths[k, ::COARSE]) > MARGIN), None)
