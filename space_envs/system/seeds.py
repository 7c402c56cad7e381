"""Lists of seeds as people write them."""

import itertools
import re

from space_envs.errors import ConfigurationError

MOST = 10_000  # seeds of a list


def parse_seeds(text: str) -> tuple[int, ...]:
    """Seeds from numbers and ranges like 0-9 or 0,3,5-7.

    Raises:
        ConfigurationError: for other text, a seed named twice, or more than `MOST`.
    """
    spans: list[range] = []
    for part in text.split(","):
        match = re.fullmatch(r"\s*(\d{1,10})(?:-(\d{1,10}))?\s*", part)
        first, last = (int(match[1]), int(match[2] or match[1])) if match else (1, 0)
        if last < first:
            raise ConfigurationError(f"seeds are numbers and ranges like 0-9 or 0,3,5-7, got {text!r}")
        spans.append(range(first, last + 1))
    if sum(map(len, spans)) > MOST:
        raise ConfigurationError(
            f"{text!r} are {sum(map(len, spans)):,} seeds; at most {MOST:,} are possible"
        )
    seeds = tuple(itertools.chain(*spans))
    if len(set(seeds)) < len(seeds):
        twice = next(seed for seed in seeds if seeds.count(seed) > 1)
        raise ConfigurationError(f"seeds: {twice} is there twice")
    return seeds
