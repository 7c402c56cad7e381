"""Probabilistic movement primitives: a Gaussian over trajectories, learned from demonstrations.

Source: shyam2020, section V and appendices I to III, as read in the project's notes on that paper.

numpy only. Weights are laid out (DoF, basis function), flattened with the DoF first. Angles are in rad,
durations in s, the phase runs from 0 at the start of a motion to 1 at its end.
"""

from promp.basis import GaussianBasis
from promp.errors import ConditioningError, PrompError, StorageError
from promp.gaussian import condition_gaussian
from promp.promp import ProMP, Trajectories
from promp.regression import regress_weights
from promp.via_points import ViaPoint

__all__ = [
    "ConditioningError",
    "GaussianBasis",
    "ProMP",
    "PrompError",
    "StorageError",
    "Trajectories",
    "ViaPoint",
    "condition_gaussian",
    "regress_weights",
]
