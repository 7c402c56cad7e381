"""A learned policy in one file: the network's arrays and a JSON header in an npz, without pickles."""

import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from agents.policies.learned.features import Feature, FeatureView, feature_table
from agents.policies.learned.network import Network
from space_envs.control import CONTROL_MODES
from space_envs.errors import ConfigurationError, PolicyError, SpaceEnvsError, positive, shown, unknown_name
from space_envs.policy import Knowledge
from space_envs.robots.robot import Robot
from space_envs.system.files import write_arrays
from space_envs.system.reading import parse_json, read_arrays
from space_envs.tasks.common import ObservationLayout

FORMAT = 2
PLAN_KINDS = ("kept", "reactionless")
_HEADER = {
    "format": int,
    "env_id": str,
    "control_mode": str,
    "robots": dict,
    "features": list,
    "home": list,
    "activation": str,
    "squash": bool,
    "notes": dict,
}


class PlanFormat(NamedTuple):
    """Meaning of a network's outputs as a plan at the start of an episode.

    Attributes:
        kind: "kept", coordinates of a motion in weight space that ends with the initial attitude, or
            "reactionless", weights of a path in the reaction null space.
        duration: of the motion, s.
    """

    kind: str
    duration: float


@dataclass(frozen=True, eq=False)
class PolicyFile:
    """A learned policy: network, features and provenance.

    Attributes:
        env_id, control_mode: what the policy was trained for.
        robots: names of the robots that it is for, by their digests: of the one that it was trained with and
            of its other variants, if it was tested with them.
        network: from features to actions.
        features: what the network sees of an observation.
        home: (n,) rad, joint angles that the features are relative to.
        notes: provenance and the validation result; any JSON object.
        plans: meaning of the network's outputs; None if they are actions.
    """

    env_id: str
    control_mode: str
    robots: dict[str, str]
    network: Network
    features: tuple[Feature, ...]
    home: tuple[float, ...]
    notes: dict[str, Any]
    plans: PlanFormat | None = None

    @property
    def knowledge(self) -> Knowledge:
        """Knowledge that it was trained with, as its notes state."""
        stated = self.notes.get("knowledge", Knowledge.UNSTATED)
        return Knowledge(stated) if stated in list(Knowledge) else Knowledge.UNSTATED

    def check_robot(self, robot: Robot) -> None:
        """Refuse a robot that the policy is not for.

        Raises:
            PolicyError: naming both.
        """
        if robot.digest not in self.robots:
            trained = " or ".join(self.robots.values())
            raise PolicyError(f"the policy was trained for the robot {trained}, not for {robot.name!r}")

    def view(self, layout: ObservationLayout) -> FeatureView:
        """The features of observations laid out so.

        Raises:
            PolicyError: if they are not what the network was made for.
        """
        try:
            view = FeatureView(self.features, layout, np.array(self.home))
        except SpaceEnvsError as error:
            raise PolicyError(f"the policy does not fit the observation: {error}") from error
        if view.size != self.network.inputs:
            raise PolicyError(
                f"the network takes {self.network.inputs} features, the table gives {view.size}"
            )
        return view

    def save(self, path: str | Path) -> None:
        """Write the file whole or not at all."""
        header = {
            "format": FORMAT,
            "env_id": self.env_id,
            "control_mode": self.control_mode,
            "robots": self.robots,
            "features": self.features,
            "home": self.home,
            "activation": self.network.activation,
            "squash": self.network.squash,
            "notes": self.notes,
            **({} if self.plans is None else {"plans": self.plans}),
        }
        arrays: dict[str, Any] = {"header": np.array(json.dumps(header))}
        for index, (weight, bias) in enumerate(zip(self.network.weights, self.network.biases, strict=True)):
            arrays[f"weight_{index}"], arrays[f"bias_{index}"] = weight, bias
        arrays["deviation_weight"] = self.network.deviation_weight
        arrays["deviation_bias"] = self.network.deviation_bias
        write_arrays(path, arrays)


def load_policy_file(path: str | Path) -> PolicyFile:
    """Read a policy file. It is data, not code: nothing in it is executed.

    Raises:
        PolicyError: if there is no such file or it is not a sound one.
    """
    path = Path(path)
    try:
        arrays = read_arrays(path)
    except FileNotFoundError:
        raise PolicyError(f"there is no policy file {path}") from None
    except (OSError, ConfigurationError) as error:
        raise PolicyError(f"{path} is not a policy file: {error}") from error
    try:
        if "header" not in arrays:
            raise PolicyError("it has no header")
        header = _header(str(arrays.pop("header")))
        layers = range((len(arrays) - 2) // 2)
        _check_names(arrays, [f"{part}_{i}" for i in layers for part in ("weight", "bias")])
        network = Network(
            weights=tuple(arrays[f"weight_{i}"] for i in layers),
            biases=tuple(arrays[f"bias_{i}"] for i in layers),
            deviation_weight=arrays["deviation_weight"],
            deviation_bias=arrays["deviation_bias"],
            activation=header["activation"],
            squash=header["squash"],
        )
        return PolicyFile(
            env_id=header["env_id"],
            control_mode=header["control_mode"],
            robots=header["robots"],
            network=network,
            features=feature_table(header["features"]),
            home=tuple(header["home"]),
            notes=header["notes"],
            plans=_plans(header.get("plans")),
        )
    except SpaceEnvsError as error:
        raise PolicyError(f"{path} is not a sound policy file: {error}") from error


def _header(text: str) -> dict[str, Any]:
    """The header, with every field of its type.

    Raises:
        ConfigurationError, PolicyError: naming the field.
    """
    header = parse_json(text)
    if not isinstance(header, dict):
        raise PolicyError(f"its header must be an object, got {type(header).__name__}")
    if missing := [name for name in _HEADER if name not in header]:
        raise PolicyError(f"the header lacks {missing}")
    for name, kind in _HEADER.items():
        if type(header[name]) is not kind:
            raise PolicyError(f"{name} must be {kind.__name__}, got {header[name]!r}")
    if header["format"] != FORMAT:
        raise PolicyError(f"format {header['format']!r} is not known, only {FORMAT}")
    if header["control_mode"] not in CONTROL_MODES:
        raise unknown_name("control mode", header["control_mode"], CONTROL_MODES)
    if not header["robots"] or not all(type(name) is str for name in header["robots"].values()):
        raise PolicyError(f"robots must hold names by digests, got {header['robots']!r}")
    if not all(type(angle) in (int, float) and math.isfinite(angle) for angle in header["home"]):
        raise PolicyError(f"home must hold finite joint angles, got {header['home']!r}")
    return header


def _plans(value: Any) -> PlanFormat | None:
    """Meaning of outputs as plans, from what JSON made of it; PolicyError if it has another form."""
    if value is None:
        return None
    if not isinstance(value, list) or len(value) != 2 or value[0] not in PLAN_KINDS:
        raise PolicyError(
            f"plans must be a kind ({', '.join(PLAN_KINDS)}) and a duration, got {shown(value)}"
        )
    return PlanFormat(value[0], positive("duration of plans", value[1]))


def _check_names(arrays: dict[str, Any], layers: list[str]) -> None:
    expected = [*layers, "deviation_weight", "deviation_bias"]
    if set(arrays) != set(expected):
        raise PolicyError(f"it holds the arrays {sorted(arrays)}, a network has {sorted(expected)}")
    if any(array.dtype != np.float32 for array in arrays.values()):
        raise PolicyError("a network's parameters must be float32")
