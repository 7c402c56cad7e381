"""Nested dictionaries, lists, numbers and arrays in one npz without pickles: what a checkpoint is made of."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import torch as th

from space_envs.errors import ConfigurationError
from space_envs.system.files import write_arrays
from space_envs.system.reading import parse_json, read_arrays

_TREE = "tree"


def save_nested(path: str | Path, tree: Any) -> None:
    """Write a tree, whole or not at all.

    Args:
        tree: dictionaries (string or integer keys), lists, tuples, None, bool, int, float, str, numpy arrays
            and torch tensors.

    Raises:
        TypeError: for anything else in it.
    """
    arrays: dict[str, Any] = {}
    text = json.dumps(_encoded(tree, arrays))
    write_arrays(path, {_TREE: np.array(text), **arrays})


def load_nested(path: str | Path) -> Any:
    """Read what `save_nested` wrote. It is data, not code: nothing in it is executed.

    Raises:
        ConfigurationError: if it is no such file.
    """
    try:
        arrays = read_arrays(path)
        return _decoded(parse_json(str(arrays[_TREE])), arrays)
    except (OSError, ValueError, KeyError, TypeError, RecursionError) as error:
        raise ConfigurationError(f"{path} is not a sound checkpoint: {error}") from error


def _encoded(value: Any, arrays: dict[str, Any]) -> Any:
    """JSON where containers and arrays are [kind, content]."""
    if value is None or isinstance(value, bool | int | float | str):
        return value
    if isinstance(value, dict):
        return ["dict", [[key, _encoded(item, arrays)] for key, item in value.items()]]
    if isinstance(value, list | tuple):
        kind = "tuple" if isinstance(value, tuple) else "list"
        return [kind, [_encoded(item, arrays) for item in value]]
    if not isinstance(value, np.ndarray | th.Tensor):
        raise TypeError(f"a checkpoint cannot hold {type(value).__name__}")
    name = f"array_{len(arrays)}"
    tensor = isinstance(value, th.Tensor)
    arrays[name] = value.detach().cpu().numpy() if isinstance(value, th.Tensor) else value
    return ["tensor" if tensor else "array", name]


def _decoded(value: Any, file: Any) -> Any:
    if not isinstance(value, list):
        return value
    kind, content = value
    if kind == "dict":
        return {key: _decoded(item, file) for key, item in content}
    if kind == "list":
        return [_decoded(item, file) for item in content]
    if kind == "tuple":
        return tuple(_decoded(item, file) for item in content)
    if kind == "array":
        return file[content]
    if kind == "tensor":
        return th.from_numpy(np.array(file[content]))
    raise ValueError(f"unknown kind {kind!r}")
