"""Planar robots in motion as one animated SVG: no script, no renderer, and it moves in any browser.

Links are nested groups, each rotated in its parent by its joint, so that a few numbers a frame make the whole
motion. A page may stop it and set its time through the svg element's own methods.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from html import escape

import numpy as np

from space_envs.dynamics.rotations import Array

REST = 1.5  # s, at the end, before it begins again
_PIXELS = 58.0  # a metre


@dataclass(frozen=True, eq=False)
class Chain:
    """An arm of a planar robot: `mount` (2,) m in the base's frame, links (m) m, angles (F, m) rad."""

    mount: Array
    links: Sequence[float]
    angles: Array
    color: str


@dataclass(frozen=True, eq=False)
class AnimatedRobot:
    """One robot with its target.

    Attributes:
        base: (F, 2) m and rotation: (F,) rad of the base. chains: its arms.
        target: (2,) m, target_rotation: (F,) rad, grapples: (g, 2) m in the target's frame.
        trails: paths of the end-effectors, (F, 2) m each, one a chain.
        level: (F,) quantity used so far, of `most`; the bar below the robot.
        label: of the bar.
    """

    title: str
    base: Array
    rotation: Array
    chains: Sequence[Chain]
    target: Array
    target_rotation: Array
    grapples: Array
    trails: Sequence[Array]
    level: Array
    most: float
    label: str


@dataclass(frozen=True)
class Movie:
    """An animated SVG, inline: `motion` seconds of the robot's time in a loop of `seconds` with a rest."""

    key: str
    title: str
    caption: str
    svg: str
    alt: str
    motion: float
    seconds: float
    rest: float = REST

    kind = "movie"


def animate(
    scenes: Sequence[AnimatedRobot],
    duration: float,
    box: tuple[float, float, float, float],
    columns: int = 2,
) -> tuple[str, float]:
    """The svg element and the length of its loop in s.

    Args:
        scenes: of equal numbers of frames F, equally spaced over the motion.
        duration: s that the motion takes on the page. box: least x and y, largest x and y shown, m.
    """
    left, bottom, right, top = box
    width, height = (right - left) * _PIXELS, (top - bottom) * _PIXELS
    head, foot, gap = 22.0, 28.0, 12.0
    across = min(columns, len(scenes))
    down = -(-len(scenes) // across)
    total = across * width + (across - 1) * gap, down * (height + head + foot) + (down - 1) * gap
    clock = _Clock(len(scenes[0].base), duration)
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {total[0]:.0f} {total[1]:.0f}" '
        'fill="none" stroke-linecap="round" stroke-linejoin="round">'
    ]
    for number, scene in enumerate(scenes):
        x = (number % across) * (width + gap)
        y = (number // across) * (height + head + foot + gap)
        parts.append(f'<g transform="translate({x:.1f} {y:.1f})">')
        parts.append(
            '<text x="4" y="14" fill="currentColor" font-size="12" font-weight="600">'
            f"{escape(scene.title)}</text>"
        )
        parts.append(
            f'<rect x="0.5" y="{head}" width="{width - 1:.1f}" height="{height:.1f}" rx="8" '
            'stroke="currentColor" stroke-opacity="0.18"/>'
        )
        # Metres, y up, from here on.
        parts.append(
            f'<g transform="translate({-left * _PIXELS:.2f} {head + top * _PIXELS:.2f}) '
            f'scale({_PIXELS} {-_PIXELS})" stroke-width="0.03">'
        )
        parts += _scene(scene, clock)
        parts.append("</g>")
        parts += _bar(scene, clock, width, head + height + 10)
        parts.append("</g>")
    parts.append("</svg>")
    return "".join(parts), clock.seconds


class _Clock:
    """Key times of an animation of `frames` frames and a rest at the end."""

    def __init__(self, frames: int, duration: float) -> None:
        self.seconds = duration + REST
        times = [*(np.linspace(0.0, duration, frames) / self.seconds), 1.0]
        self._times = ";".join(f"{time:.5g}" for time in times)
        self._common = f'keyTimes="{self._times}" dur="{self.seconds:g}s" repeatCount="indefinite"'

    def transform(self, kind: str, values: Array) -> str:
        """Animate a translation (F, 2) or a rotation (F,) in degrees."""
        rows = np.atleast_2d(np.asarray(values, dtype=np.float64).T).T
        rows = np.concatenate([rows, rows[-1:]])
        text = ";".join(" ".join(_number(value, 4) for value in row) for row in rows)
        return f'<animateTransform attributeName="transform" type="{kind}" values="{text}" {self._common}/>'

    def attribute(self, name: str, values: Array) -> str:
        """Animate a plain attribute (F,)."""
        text = ";".join(_number(value, 2) for value in [*values, values[-1]])
        return f'<animate attributeName="{name}" values="{text}" {self._common}/>'


def _number(value: float, digits: int) -> str:
    text = f"{value:.{digits}f}".rstrip("0").rstrip(".")
    return "0" if text in ("-0", "") else text


def _scene(scene: AnimatedRobot, clock: _Clock) -> list[str]:
    parts = []
    for chain, trail in zip(scene.chains, scene.trails, strict=True):
        points = " ".join(f"{_number(x, 3)},{_number(y, 3)}" for x, y in trail)
        parts.append(
            f'<polyline points="{points}" stroke="{chain.color}" stroke-width="0.035" '
            'stroke-dasharray="0.02 0.08"/>'
        )
    x, y = scene.target
    parts.append(f'<g transform="translate({_number(x, 3)} {_number(y, 3)})"><g>')
    parts.append(clock.transform("rotate", np.rad2deg(scene.target_rotation)))
    half = np.abs(scene.grapples).max()
    parts.append(
        f'<rect x="-0.2" y="{_number(-0.72 * half, 3)}" width="0.4" height="{_number(1.44 * half, 3)}" '
        'rx="0.05" stroke="currentColor" fill="currentColor" fill-opacity="0.16"/>'
    )
    for (gx, gy), chain in zip(scene.grapples, scene.chains, strict=True):
        at = f'cx="{_number(gx, 3)}" cy="{_number(gy, 3)}"'
        parts.append(f'<path d="M0 0L{_number(gx, 3)} {_number(gy, 3)}" stroke="currentColor"/>')
        parts.append(f'<circle {at} r="0.07" stroke="{chain.color}" stroke-width="0.035"/>')
    parts.append("</g></g>")
    parts.append("<g>")
    parts.append(clock.transform("translate", scene.base))
    parts.append("<g>")
    parts.append(clock.transform("rotate", np.rad2deg(scene.rotation)))
    parts.append(
        '<rect x="-0.5" y="-0.5" width="1" height="1" rx="0.06" stroke="currentColor" '
        'fill="currentColor" fill-opacity="0.1"/><path d="M0 0.14V-0.14M-0.14 0H0.14" stroke="currentColor" '
        'stroke-opacity="0.55"/>'
    )
    for chain in scene.chains:
        parts += _chain(chain, clock)
    parts.append("</g></g>")
    return parts


def _chain(chain: Chain, clock: _Clock) -> list[str]:
    x, y = chain.mount
    parts = [f'<g transform="translate({_number(x, 3)} {_number(y, 3)})">']
    for number, length in enumerate(chain.links):
        parts.append("<g>")
        parts.append(clock.transform("rotate", np.rad2deg(chain.angles[:, number])))
        parts.append(
            f'<path d="M0 0H{_number(length, 3)}" stroke="{chain.color}" stroke-width="0.085"/>'
            f'<circle r="0.06" fill="currentColor"/><g transform="translate({_number(length, 3)} 0)">'
        )
    parts.append(f'<circle r="0.05" fill="{chain.color}"/>')
    parts.append("</g></g>" * len(chain.links) + "</g>")
    return parts


def _bar(scene: AnimatedRobot, clock: _Clock, width: float, y: float) -> list[str]:
    full = 0.5 * width
    values = full * np.clip(scene.level / scene.most, 0.0, 1.0)
    return [
        f'<rect x="4" y="{y:.1f}" width="{full:.1f}" height="9" rx="4.5" fill="currentColor" '
        'fill-opacity="0.12"/>',
        f'<rect x="4" y="{y:.1f}" width="{_number(values[-1], 2)}" height="9" rx="4.5" '
        f'fill="{scene.chains[0].color}">{clock.attribute("width", values)}</rect>',
        f'<text x="{full + 14:.1f}" y="{y + 9:.1f}" fill="currentColor" font-size="11">'
        f"{escape(scene.label)}</text>",
    ]
