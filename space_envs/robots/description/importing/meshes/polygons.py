"""Polygons of COLLADA as triangles."""

import xml.etree.ElementTree as ET

import numpy as np
from numpy.typing import NDArray

Indices = NDArray[np.int64]


def counts(group: ET.Element, places: Indices, lengths: list[int]) -> Indices:
    """Number of corners of each polygon of a primitive."""
    if group.tag == "triangles":
        return np.full(len(places) // 3, 3)
    if group.tag == "polygons":
        return np.array(lengths, dtype=np.int64)
    count = group.find("vcount")
    return np.array((count.text or "").split() if count is not None else [], dtype=np.int64)


def triangles(sizes: Indices, places: Indices) -> Indices:
    """(m, 3) corners of triangles, from polygons whose corners stand one after another."""
    if sizes.sum() != len(places):
        raise ValueError("polygons and their corners do not match")
    first = np.concatenate([[0], np.cumsum(sizes)[:-1]]) if len(sizes) else np.zeros(0)
    fans = np.maximum(sizes - 2, 0)
    start = np.repeat(first, fans).astype(np.int64)
    step = np.arange(len(start)) - np.repeat(np.cumsum(fans) - fans, fans) + 1
    return places[np.stack([start, start + step, start + step + 1], axis=1)]
