"""Scenes and motions as JSON for the page: arrays are quantised, deflated and written in base64."""

import base64
import json
import zlib
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from markupsafe import Markup
from numpy.typing import ArrayLike, NDArray

from space_envs.evaluation.replay.replay import Replay
from space_envs.evaluation.replay.scenes import ReplayMotion, ReplayScene

_FULL = 32767  # of a signed 16-bit number


def json_text(value: Any) -> Markup:
    """JSON that can stand inside a script element: no character of it begins a tag or ends a line."""
    text = json.dumps(value, allow_nan=False, separators=(",", ":"))
    for character in "<>&\u2028\u2029":
        text = text.replace(character, f"\\u{ord(character):04x}")
    return Markup(text)


def packed(arrays: Sequence[NDArray[Any]]) -> str:
    """The arrays' little-endian bytes one after the other, deflated, in base64."""
    raw = b"".join(array.astype(array.dtype.newbyteorder("<")).tobytes() for array in arrays)
    return base64.b64encode(zlib.compress(raw, 9)).decode("ascii")


def quantised(values: NDArray[np.float64]) -> tuple[NDArray[np.int16], float]:
    """Integers and their unit: values = integers * unit, to half a unit."""
    unit = float(np.abs(values).max(initial=0.0)) / _FULL or 1.0
    return np.round(values / unit).astype(np.int16), unit


def scene_values(scene: ReplayScene) -> dict[str, Any]:
    """Vertices (int16 x 3), triangles (uint32 x 3), normals and gloss (int8 x 4), colors (uint8 x 4) and
    body (uint8), in this order, in `data`; the rest as numbers."""
    vertices, unit = quantised(scene.vertices)
    normals = np.concatenate([scene.normals, scene.gloss[:, None].clip(0, 1)], axis=1)
    data = packed(
        [
            scene.triangles.astype(np.uint32),
            vertices,
            np.round(127 * normals).astype(np.int8),
            np.round(255 * scene.colors).astype(np.uint8),
            scene.body.astype(np.uint8),
        ]
    )
    return {
        "vertices": len(scene.vertices),
        "triangles": len(scene.triangles),
        "opaque": scene.opaque,
        "unit": unit,
        "bodies": len(scene.bodies),
        "endEffectors": [{"body": body, "place": _short(place)} for _, body, place in scene.end_effectors],
        "eye": _short(scene.eye),
        "centre": _short(scene.centre),
        "fovy": scene.fovy,
        "sun": _short(scene.sun),
        "planet": None if scene.planet is None else _short(scene.planet),
        "data": data,
    }


def frames(steps: int, stride: int) -> NDArray[np.int64]:
    """Indices of the states that are shown, of steps + 1: every `stride`-th, the first and the last."""
    return np.unique(np.append(np.arange(0, steps + 1, stride), steps))


def replay_values(replay: Replay, motion: ReplayMotion, stride: int = 1) -> dict[str, Any]:
    """Frame times, courses and, in `data`, positions (int16, F x B x 3), then quaternions (int16, F x B x 4).

    Both are differences from frame to frame, modulo 2^16, which deflate well.
    """
    shown = frames(len(replay.time) - 1, stride)
    positions, unit = quantised(motion.position[shown])
    quaternions = np.round(_FULL * motion.quaternion[shown]).astype(np.int16)
    return {
        "label": replay.label,
        "seed": replay.seed,
        "episode": replay.episode,
        "index": replay.index,
        "outcome": replay.outcome,
        "reason": replay.reason,
        "time": _short(replay.time[shown]),
        "attitude": _short(replay.attitude[shown]),
        "distance": _short(replay.distance[shown]),
        "size": _short(motion.size),
        "unit": unit,
        "data": packed([_steps(positions), _steps(quaternions)]),
    }


def size_of(values: Mapping[str, Any]) -> int:
    """Number of characters that values take in the page."""
    return len(json_text(values))


def _steps(values: NDArray[np.int16]) -> NDArray[np.int16]:
    """First differences along the first axis, the first value kept; what overflows wraps around."""
    return np.concatenate([values[:1], np.diff(values, axis=0)])


def _short(values: ArrayLike) -> list[float]:
    """Numbers rounded to five significant digits."""
    return [float(f"{value:.5g}") for value in np.asarray(values, dtype=float).ravel().tolist()]
