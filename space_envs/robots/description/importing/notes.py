"""Sentences about what an imported robot leaves out or assumes, and the errors of what it cannot."""

from collections.abc import Sequence

from space_envs.errors import ConfigurationError
from space_envs.robots.description.importing.plausible import inertia_problem
from space_envs.robots.description.importing.rigid import RigidParts


def assembly_notes(parts: RigidParts) -> list[str]:
    """Sentences about joints that are fixed, and links without mass or with an inertia that no body has.

    Raises:
        ConfigurationError: for a rigid part whose inertia no body has.
    """
    return [*_joint_notes(parts), *_mass_notes(parts), *_inertia_notes(parts)]


def _joint_notes(parts: RigidParts) -> list[str]:
    tree, notes = parts.tree, []
    still = [
        joint
        for body in parts.placed
        if body != parts.root
        for joint in tree.bodies[body].joints
        if joint.name not in parts.moving
    ]
    above = [joint.name for joint in tree.bodies[parts.root].joints]
    if above:
        notes.append(f"the root is fixed to the satellite: the joint {above[0]} above it is left out.")
    if locked := [f"{j.name} at {parts.value(j):g}" for j in still if j.name in parts.values]:
        notes.append(f"locked joints: {', '.join(locked)}.")
    if other := [f"{j.name} at {parts.value(j):g}" for j in still if j.name not in parts.values]:
        notes.append(f"joints that are not between root and tool are fixed: {', '.join(other)}.")
    return notes


def _mass_notes(parts: RigidParts) -> list[str]:
    bodies = [parts.tree.bodies[body] for body in parts.placed]
    bare = [body.name for body in bodies if body.inertial is None and any(s.solid for s in body.shapes)]
    return [f"links without inertia count as massless: {', '.join(bare)}."] if bare else []


def _inertia_notes(parts: RigidParts) -> list[str]:
    """Sentences about inertias that no body has, in parts that are physical as a whole; errors of others."""
    notes = []
    for carrier in (parts.root, *parts.frames):
        found = [parts.tree.bodies[body] for body, _ in parts.members(carrier)]
        problems = [problem for body in found if (problem := inertia_problem(body.name, body.inertial))]
        whole = inertia_problem(parts.tree.bodies[carrier].name, parts.inertial(carrier))
        if whole is not None:
            raise ConfigurationError(problems[0] if problems else whole)
        notes += [
            f"{problem}. It is used, since with what is fixed to it, it is possible." for problem in problems
        ]
    return notes


def drawing_notes(problems: Sequence[str]) -> list[str]:
    """A sentence about drawings that are missing, with the reason for the first."""
    if not problems:
        return []
    return [
        f"drawings that contact geometry replaces, or nothing: {len(problems)}; the first: {problems[0]}."
    ]
