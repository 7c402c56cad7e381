"""Networks from zip files of stable-baselines3, read as data: no pickle in them is ever opened.

A zip holds `data`, which is JSON, and `policy.pth`, the network's arrays. What stable-baselines3 cannot write
as JSON it adds as a pickle in base64, together with a description in plain text; only the latter is read. The
arrays are read by torch's loader of arrays alone, which refuses everything else.
"""

import io
import re
import zipfile
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from agents.policies.learned.network import Network
from space_envs.errors import PolicyError, SpaceEnvsError
from space_envs.system.reading import parse_json, read_bytes

LARGEST = {"data": 64 * 2**20, "policy.pth": 512 * 2**20}  # bytes; no honest file of these tasks is near it
_OTHERWISE = "load it in a class of your own and name that as package.module:Class (docs/extending.md)"
_ACTIVATIONS = {
    "Tanh": "tanh",
    "ReLU": "relu",
    "LeakyReLU": "leaky_relu",
    "ELU": "elu",
    "SiLU": "silu",
    "GELU": "gelu",
}


@dataclass(frozen=True)
class _Family:
    """Names of the parts of one of stable-baselines3's policy classes.

    Attributes:
        algorithms: that have it. module: of the class. activation: its default.
        hidden: layers before the mean. mean: layer; None if the last of `hidden` is it.
        deviation: parameter, or layer, of the log standard deviation; None where there is none.
        squash: whether actions go through tanh. others: prefixes of what does not act.
    """

    algorithms: str
    module: str
    activation: str
    hidden: str
    mean: str | None
    deviation: str | None
    squash: bool
    others: tuple[str, ...]


_CRITICS = ("critic.", "critic_target.", "actor_target.")
_FAMILIES = {
    "ActorCriticPolicy": _Family(
        "PPO and A2C",
        "stable_baselines3.common.policies",
        "tanh",
        "mlp_extractor.policy_net",
        "action_net",
        "log_std",
        False,
        ("value_net.", "mlp_extractor.value_net."),
    ),
    "SACPolicy": _Family(
        "SAC",
        "stable_baselines3.sac.policies",
        "relu",
        "actor.latent_pi",
        "actor.mu",
        "actor.log_std",
        True,
        _CRITICS,
    ),
    "TD3Policy": _Family(
        "TD3 and DDPG", "stable_baselines3.td3.policies", "relu", "actor.mu", None, None, True, _CRITICS
    ),
}


def load_network(path: str | Path) -> Network:
    """The network that acts in a zip of stable-baselines3. Nothing in the file is executed.

    Raises:
        PolicyError: if there is no such file, it is damaged, or its policy is not a plain multilayer
            perceptron with actions in [-1, 1]; the message names what was found.
    """
    try:
        with zipfile.ZipFile(io.BytesIO(read_bytes(path, sum(LARGEST.values()) * 4))) as archive:
            content = {name: _read(archive, name) for name in LARGEST}
        data = parse_json(content["data"])
        if not isinstance(data, dict):
            raise PolicyError("its `data` is not a JSON object")
        family = _family(data)
        activation = _activation(data, family)
        _check_spaces(data)
        network = _network(_arrays(content["policy.pth"]), family, activation)
    except FileNotFoundError:
        raise PolicyError(f"there is no file {path}") from None
    except SpaceEnvsError as error:
        raise PolicyError(f"{path}: {error}") from error
    except (OSError, ValueError, RuntimeError, EOFError, zipfile.BadZipFile, zlib.error) as error:
        raise PolicyError(f"{path} is not a whole zip of stable-baselines3: {error}") from error
    for name, size in (("observation_space", network.inputs), ("action_space", network.outputs)):
        if data[name]["_shape"] != [size]:
            raise PolicyError(f"{path}: its {name} has shape {data[name]['_shape']}, its network {[size]}")
    return network


def _read(archive: zipfile.ZipFile, name: str) -> bytes:
    try:
        size = archive.getinfo(name).file_size
    except KeyError:
        raise PolicyError(
            f"it holds no `{name}`, so it is damaged, or no model that stable-baselines3 saved; there are "
            f"{', '.join(archive.namelist()[:8]) or 'no files'}"
        ) from None
    if size > LARGEST[name]:
        raise PolicyError(f"its `{name}` has {size:,} bytes; at most {LARGEST[name]:,} are read")
    return archive.read(name)


def _family(data: dict[str, Any]) -> _Family:
    """The known policy class that the description names; refuses an actor that is not a plain one."""
    described = data.get("policy_class")
    described = described if isinstance(described, dict) else {}
    module = str(described.get("__module__", "unknown"))
    # A class is described by its attributes; a function's qualified name has the class it was defined in.
    named = re.match(r"<function (\w+)\.__init__ at ", str(described.get("__init__", "")))
    name = named[1] if named else "a class"
    family = _FAMILIES.get(name)
    if family is None or family.module != module:
        known = ", ".join(f"{each} ({_FAMILIES[each].algorithms})" for each in _FAMILIES)
        raise PolicyError(
            f"its policy is {name} of module {module}; what can be read is MlpPolicy: {known}. For any "
            f"other, {_OTHERWISE}"
        )
    keywords = data.get("policy_kwargs")
    extractor = keywords.get("features_extractor_class") if isinstance(keywords, dict) else None
    if extractor is not None and not str(extractor).endswith(".FlattenExtractor'>"):
        raise PolicyError(f"its policy has the features extractor {extractor}; {_OTHERWISE}")
    if data.get("use_sde"):
        raise PolicyError("it was trained with state-dependent exploration (use_sde=True), which is not read")
    if _normalised(data):
        raise PolicyError(
            "it was trained on observations that VecNormalize changed, whose statistics stable-baselines3 "
            f"keeps in a pickle of their own; {_OTHERWISE}"
        )
    return family


def _normalised(data: dict[str, Any]) -> bool:
    """Whether VecNormalize stood between environment and model, as far as the file shows it.

    The model keeps its last observation and, where it trained with VecNormalize or off policy, the
    environment's. The former is float32 if it was normalised, the latter float64: their pickles differ in
    length.
    """
    seen, original = (data.get(name) for name in ("_last_obs", "_last_original_obs"))
    if not (isinstance(seen, dict) and isinstance(original, dict)):
        return False
    return len(str(seen.get(":serialized:"))) != len(str(original.get(":serialized:")))


def _activation(data: dict[str, Any], family: _Family) -> str:
    keywords = data.get("policy_kwargs")
    described = keywords.get("activation_fn") if isinstance(keywords, dict) else None
    if described is None:
        return family.activation
    named = re.fullmatch(r"<class 'torch\.nn\.modules\.activation\.(\w+)'>", str(described))
    if named is None or named[1] not in _ACTIVATIONS:
        raise PolicyError(f"its activation is {described}; known are {', '.join(_ACTIVATIONS)}")
    return _ACTIVATIONS[named[1]]


def _check_spaces(data: dict[str, Any]) -> None:
    """Boxes with one axis, and actions in [-1, 1]."""
    for name in ("observation_space", "action_space"):
        space = data.get(name)
        space = space if isinstance(space, dict) else {}
        kind = str(space.get(":type:", "unknown"))
        if not kind.endswith(".Box'>") or not isinstance(space.get("_shape"), list):
            raise PolicyError(f"its {name} is {kind}; it must be a Box, described as such")
        if len(space["_shape"]) != 1:
            raise PolicyError(f"its {name} has shape {space['_shape']}; it must have one axis")
    for name, bound in (("low", -1.0), ("high", 1.0)):
        # The text of a numpy array.
        values = str(data["action_space"].get(name, "")).strip("[]").split()
        if not values or any(_number(value) != bound for value in values):
            raise PolicyError(
                f"the {name} of its action_space is {data['action_space'].get(name)}; it must be {bound:g}, "
                "as in the environments here"
            )


def _number(text: str) -> float | None:
    try:
        return float(text)
    except ValueError:
        return None


def _arrays(content: bytes) -> dict[str, NDArray[np.float32]]:
    import torch as th  # seconds to import

    try:
        found = th.load(io.BytesIO(content), map_location="cpu", weights_only=True)
    # Damaged bytes make torch raise a dozen unrelated types, and its own words advise to unpickle.
    except Exception as error:
        raise PolicyError(
            f"its `policy.pth` is damaged or holds more than arrays; nothing of it was executed "
            f"({type(error).__name__})"
        ) from None
    if not isinstance(found, dict) or not all(
        isinstance(name, str) and isinstance(value, th.Tensor) for name, value in found.items()
    ):
        raise PolicyError("its `policy.pth` is not a table of named arrays")
    if any(value.dtype != th.float32 or value.layout != th.strided for value in found.values()):
        raise PolicyError("its `policy.pth` holds arrays that are not float32")
    # A tensor may claim more elements than the file has.
    if 4 * sum(value.numel() for value in found.values()) > len(content):
        raise PolicyError("its `policy.pth` has arrays larger than itself")
    return {name: value.detach().numpy() for name, value in found.items()}


def _network(arrays: dict[str, NDArray[np.float32]], family: _Family, activation: str) -> Network:
    """The actor's layers in their order."""
    pattern = re.compile(rf"{re.escape(family.hidden)}\.(\d+)\.weight")
    found = sorted(int(match[1]) for match in map(pattern.fullmatch, arrays) if match)
    layers = [f"{family.hidden}.{index}" for index in range(0, 2 * len(found), 2)]  # activations between
    if family.mean is not None:
        layers.append(family.mean)
    used = {f"{layer}.{part}" for layer in layers for part in ("weight", "bias")}
    linear = family.deviation is not None and f"{family.deviation}.weight" in arrays
    if linear:
        used |= {f"{family.deviation}.weight", f"{family.deviation}.bias"}
    elif family.deviation is not None:
        used.add(family.deviation)
    actor = {name for name in arrays if not name.startswith(family.others)}
    if not layers or actor != used:
        raise PolicyError(
            f"its actor is no plain multilayer perceptron: unexpected {sorted(actor - used) or 'nothing'}, "
            f"missing {sorted(used - actor) or 'nothing'}; {_OTHERWISE}"
        )
    flat = [name for name in used if arrays[name].ndim != (2 if name.endswith(".weight") else 1)]
    if flat:
        raise PolicyError(f"its {flat[0]} has shape {arrays[flat[0]].shape}, which no layer has")
    weights = tuple(np.ascontiguousarray(arrays[f"{layer}.weight"].T) for layer in layers)
    biases = tuple(arrays[f"{layer}.bias"] for layer in layers)
    if linear:
        weight = np.ascontiguousarray(arrays[f"{family.deviation}.weight"].T)
        bias = arrays[f"{family.deviation}.bias"]
    else:
        weight = np.zeros_like(weights[-1])
        # TD3 has no deviation of its own: e^-20 is none.
        bias = np.full_like(biases[-1], -20.0) if family.deviation is None else arrays[family.deviation]
    return Network(weights, biases, weight, bias, activation, family.squash)
