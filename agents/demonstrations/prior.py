"""The ProMP prior that is learned from demonstrations."""

from pathlib import Path
from typing import Any

from agents.demonstrations.controller import Demonstrations
from promp import ProMP
from space_envs.system.digests import file_digest
from space_envs.system.files import write_json

# rad, of every weight. All demonstrations start at home, at rest; the noise lets a plan start elsewhere.
WEIGHT_NOISE = 1e-3


def fit_prior(demonstrations: Demonstrations) -> ProMP:
    """The ProMP of eq. 16 and 17; every demonstration's weights meet its first and last state exactly."""
    return ProMP.fit(
        demonstrations.position,
        demonstrations.velocity,
        duration=float(demonstrations.time[-1]),
        exact_ends=True,
        weight_noise=WEIGHT_NOISE,
    )


def save_prior(path: Path, prior: ProMP, origin: dict[str, Any]) -> None:
    """Write a prior to `path`, and its origin to the same name with suffix .json."""
    prior.save(path)
    digest = file_digest(path)
    origin = origin | {"file": path.name, "sha256": digest, "weight_noise": WEIGHT_NOISE}
    write_json(path.with_suffix(".json"), dict(sorted(origin.items())))
