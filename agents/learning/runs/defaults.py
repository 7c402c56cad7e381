"""Hyperparameters where a user gives none: those of the algorithm, with the differences of an id."""

from collections.abc import Mapping
from typing import Any

from agents.learning.runs.feature_tables import (
    CLUTTERED_FEATURES,
    DUAL_PLANAR_FEATURES,
    DUAL_SPATIAL_FEATURES,
    PLANNER_FEATURES,
    SINGLE_ARM_FEATURES,
    usual_features,
)
from agents.learning.runs.hyperparameters import ALGORITHMS, AnyHyperparameters
from space_envs.errors import unknown_name
from space_envs.tasks.common import ObservationLayout

Differences = Mapping[str, Mapping[str, Any]]  # hyperparameters by algorithm

_SINGLE_ARM = {"ppo": {"minutes": 9.0}}
# ppo is gentle: the clone captures nearly everything already, and must not be unlearned by a bad critic.
_DUAL_ARM = {
    "bc": {
        "hidden": (256, 256),
        "validation_interval": 4 * 200 * 128,
        "episode_steps": 200,
        "error_offset": 0.02,
        "expert_noise": 0.05,
    },
    "ppo": {
        "hidden": (256, 256),
        "steps": 1_000_000,
        "minutes": 7.0,
        "learning_rate": 5e-5,
        "batch_size": 2048,
        "validation_interval": 100_000,
        "n_epochs": 4,
        "clip_range": 0.1,
        "target_kl": 0.01,
        "critic_warm_up": 150_000,
        "action_deviation": 0.03,
    },
    "sac": {"hidden": (256, 256)},
    "td3": {"hidden": (256, 256)},
    "tqc": {"hidden": (256, 256)},
    "crossq": {"hidden": (256, 256)},
}
# Paths in the reaction null space: longer steps in other coordinates, and limits are what is hard.
REACTIONLESS_PLANNER = {
    "damping": 1e-3,
    "position_weight": 100.0,
    "rotation_weight": 30.0,
    "limit_weight": 3.0,
    "rate_share": 0.9,
    "acceleration_share": 0.86,
    "num_envs": 256,
    "steps": 1_500 * 256,
    "reuse": 6,
    "validation_interval": 300 * 256,
}
_FEATURES = {
    "SpaceCapture/SingleArm-v0": SINGLE_ARM_FEATURES,
    "SpaceCapture/SingleArmCluttered-v0": CLUTTERED_FEATURES,
    "SpaceCapture/DualArmPlanar-v0": DUAL_PLANAR_FEATURES,
    "SpaceCapture/DualArmSpatial-v0": DUAL_SPATIAL_FEATURES,
}
_DIFFERENCES: dict[str, Differences] = {
    "SpaceCapture/SingleArm-v0": _SINGLE_ARM,
    "SpaceCapture/SingleArmCluttered-v0": _SINGLE_ARM,
    "SpaceCapture/DualArmPlanar-v0": _DUAL_ARM | {"bc": _DUAL_ARM["bc"] | {"steps": 8 * 200 * 128}},
    "SpaceCapture/DualArmSpatial-v0": _DUAL_ARM | {"bc": _DUAL_ARM["bc"] | {"steps": 10 * 200 * 128}},
}


def default_hyperparameters(
    env_id: str, algorithm: str, layout: ObservationLayout, given: Mapping[str, Any] | None = None
) -> AnyHyperparameters:
    """Hyperparameters of an algorithm for an id, with those that are given in place of the defaults.

    Args:
        layout: of the id's observations, whose usual features are taken where the id has none of its own.

    Raises:
        ConfigurationError: for an unknown algorithm, or a value that is out of its range.
    """
    if algorithm not in ALGORITHMS:
        raise unknown_name("algorithm", algorithm, ALGORITHMS)
    own = _DIFFERENCES.get(env_id, {}).get(algorithm, {})
    if algorithm == "planner" and (given or {}).get("kind") == "reactionless":
        own = REACTIONLESS_PLANNER
    usual = _FEATURES.get(env_id) or usual_features(layout)
    features = PLANNER_FEATURES if algorithm == "planner" else usual
    return ALGORITHMS[algorithm](**{"features": features, **own, **(given or {})})
