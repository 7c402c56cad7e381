"""COLLADA drawings as STL files, which MuJoCo reads, in the user's cache."""

import hashlib
from pathlib import Path
from typing import NamedTuple

import numpy as np

from space_envs.codegen.cache import LibraryError, cache_folder, private_folder
from space_envs.dynamics.rotations import Array
from space_envs.errors import ConfigurationError
from space_envs.robots.description.importing.meshes.collada import Colour, read_collada
from space_envs.system.files import atomic_write, write_json
from space_envs.system.reading import read_bytes, read_object

_FOLDER, _INDEX = "meshes", "colours.json"
_MOST_FACES, _LEAST_VERTICES = 200_000, 4  # of a file that MuJoCo reads
_FACE = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])


class Part(NamedTuple):
    """A part of a drawing, of one colour; None where the file gives none."""

    path: Path
    colour: Colour | None


def converted(path: Path) -> list[Part]:
    """Parts of a COLLADA file as STL files, made at its first use.

    Raises:
        ConfigurationError: if the file cannot be read, or there is no folder for a cache.
    """
    try:
        digest = hashlib.sha256(read_bytes(path)).hexdigest()
        folder = private_folder(cache_folder()) / _FOLDER / digest
        folder.mkdir(parents=True, exist_ok=True)
        if not (folder / _INDEX).is_file():
            _convert(path, folder)
        colours = read_object(folder / _INDEX)["colours"]
    except (OSError, LibraryError) as error:
        raise ConfigurationError(f"{path}: cannot be converted for drawings: {error}") from None
    return [Part(_part(folder, number), colour and tuple(colour)) for number, colour in enumerate(colours)]


def _part(folder: Path, number: int) -> Path:
    return folder / f"{number}.stl"


def _convert(path: Path, folder: Path) -> None:
    """Write all parts, and the index when they are complete."""
    groups: dict[Colour | None, list[Array]] = {}
    for surface in read_collada(path):
        groups.setdefault(surface.colour, []).append(surface.corners)
    colours = []
    for colour, group in groups.items():
        corners = np.concatenate(group)
        for first in range(0, len(corners), _MOST_FACES):
            piece = corners[first : first + _MOST_FACES].astype(np.float32)
            if len(np.unique(piece.reshape(-1, 3), axis=0)) < _LEAST_VERTICES:
                continue
            with atomic_write(_part(folder, len(colours))) as file:
                file.write_bytes(_stl(piece))
            colours.append(colour)
    write_json(folder / _INDEX, {"colours": colours})


def _stl(corners: Array) -> bytes:
    """Binary STL of triangles (m, 3, 3)."""
    faces = np.zeros(len(corners), dtype=_FACE)
    faces["corners"] = corners
    return bytes(80) + np.uint32(len(corners)).tobytes() + faces.tobytes()
