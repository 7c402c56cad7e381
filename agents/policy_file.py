"""A learned policy in one file: the network's arrays and a JSON header in an npz, without pickles."""

import json
import zipfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from agents.features import Feature, FeatureView, feature_table
from agents.network import Network
from space_envs.errors import PolicyError, SpaceEnvsError
from space_envs.files import atomic_write
from space_envs.tasks.common import ObservationLayout

FORMAT = 1
_HEADER = ("format", "env_id", "control_mode", "features", "home", "activation", "squash", "notes")


@dataclass(frozen=True, eq=False)
class PolicyFile:
    """What is needed to act, and where it came from.

    Attributes:
        env_id, control_mode: what the policy was trained for.
        network: from features to actions.
        features: what the network sees of an observation.
        home: (n,) rad, joint angles that the features are relative to.
        notes: provenance and the validation result; any JSON object.
    """

    env_id: str
    control_mode: str
    network: Network
    features: tuple[Feature, ...]
    home: tuple[float, ...]
    notes: dict[str, Any]

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
            "features": self.features,
            "home": self.home,
            "activation": self.network.activation,
            "squash": self.network.squash,
            "notes": self.notes,
        }
        arrays: dict[str, Any] = {"header": np.array(json.dumps(header))}
        for index, (weight, bias) in enumerate(zip(self.network.weights, self.network.biases, strict=True)):
            arrays[f"weight_{index}"], arrays[f"bias_{index}"] = weight, bias
        arrays["deviation_weight"] = self.network.deviation_weight
        arrays["deviation_bias"] = self.network.deviation_bias
        with atomic_write(path) as temporary:
            np.savez(temporary, **arrays)


def load_policy_file(path: str | Path) -> PolicyFile:
    """Read a policy file. It is data, not code: nothing in it is executed.

    Raises:
        PolicyError: if there is no such file or it is not a sound one.
    """
    path = Path(path)
    try:
        with np.load(path, allow_pickle=False) as file:
            arrays = {name: file[name] for name in file.files}
        header = json.loads(str(arrays.pop("header")))
        if header["format"] != FORMAT:
            raise PolicyError(f"{path}: format {header['format']!r} is not known, only {FORMAT}")
        if missing := [name for name in _HEADER if name not in header]:
            raise PolicyError(f"{path}: the header lacks {missing}")
        if any(array.dtype != np.float32 for array in arrays.values()):
            raise PolicyError(f"{path}: a network's parameters must be float32")
        layers = range((len(arrays) - 2) // 2)
        network = Network(
            weights=tuple(arrays[f"weight_{i}"] for i in layers),
            biases=tuple(arrays[f"bias_{i}"] for i in layers),
            deviation_weight=arrays["deviation_weight"],
            deviation_bias=arrays["deviation_bias"],
            activation=header["activation"],
            squash=bool(header["squash"]),
        )
        return PolicyFile(
            env_id=str(header["env_id"]),
            control_mode=str(header["control_mode"]),
            network=network,
            features=feature_table(header["features"]),
            home=tuple(float(angle) for angle in header["home"]),
            notes=dict(header["notes"]),
        )
    except FileNotFoundError:
        raise PolicyError(f"there is no policy file {path}") from None
    except SpaceEnvsError as error:
        raise PolicyError(f"{path} is not a sound policy file: {error}") from error
    except (OSError, ValueError, KeyError, TypeError, EOFError, zipfile.BadZipFile) as error:
        raise PolicyError(f"{path} is not a policy file: {error}") from error
