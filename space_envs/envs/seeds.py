"""Random generators of the rows of a vector environment, and their seeds."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from numbers import Integral
from typing import Any, Self

import numpy as np
from gymnasium.utils import seeding
from numpy.typing import NDArray

from space_envs.errors import ConfigurationError, shown


@dataclass(frozen=True, eq=False)
class Seeds:
    """Random generators of n rows, and their seeds.

    Without a given seed, row i has a random seed plus i.

    Attributes:
        n: number of rows.
        given: (generator, seed) of each row; seed -1 for a generator set from outside.
    """

    n: int
    given: tuple[tuple[np.random.Generator, int], ...] = ()

    @cached_property
    def _all(self) -> tuple[tuple[np.random.Generator, int], ...]:
        first = 0 if self.given else int(seeding.np_random()[1])
        return self.given or tuple(_from_seed(first + row) for row in range(self.n))

    @property
    def generators(self) -> list[np.random.Generator]:
        """(n,)"""
        return [generator for generator, _ in self._all]

    @property
    def numbers(self) -> list[int]:
        """(n,) seeds."""
        return [number for _, number in self._all]

    def renewed(self, seed: Any, rows: NDArray[np.int64]) -> "Seeds":
        """Copy with rows (k,) seeded again: row i with seed + i, or with the i-th of n seeds.

        Raises:
            ConfigurationError: if the seed is not None, an integer or n of them.
        """
        if seed is None:
            return self
        if isinstance(seed, np.ndarray) and seed.ndim == 1:
            seed = seed.tolist()
        if _whole(seed):
            seeds: list[Any] = [int(seed) + row for row in range(self.n)]
        elif isinstance(seed, list | tuple) and len(seed) == self.n:
            seeds = list(seed)
        else:
            raise ConfigurationError(
                f"seed must be an integer, a list of {self.n}, or None; got {shown(seed)}"
            )
        for number in seeds:
            if number is not None and (not _whole(number) or number < 0):
                raise ConfigurationError(f"a seed must be an integer of at least 0, got {shown(number)}")
        every = list(self._all)
        for row in rows:
            if seeds[row] is not None:
                every[row] = _from_seed(int(seeds[row]))
        return Seeds(self.n, tuple(every))

    def stored(self) -> dict[str, list[Any]]:
        """States of the generators and seeds, as plain values for `of`."""
        generators = [generator.bit_generator.state for generator in self.generators]
        return {"generators": generators, "seeds": self.numbers}

    @classmethod
    def of(cls, stored: Mapping[str, list[Any]]) -> Self:
        """Generators and seeds that were `stored`."""
        generators = [np.random.default_rng(0) for _ in stored["generators"]]
        for generator, state in zip(generators, stored["generators"], strict=True):
            generator.bit_generator.state = state
        return cls(len(generators), tuple(zip(generators, stored["seeds"], strict=True)))

    def derived(self, generator: np.random.Generator) -> "Seeds":
        """Copy whose first row has this generator and whose other rows have seeds drawn from it."""
        others = generator.integers(2**63, size=self.n - 1).tolist() if self.n > 1 else []
        return Seeds(self.n, ((generator, -1), *(_from_seed(number) for number in others)))


def _whole(value: object) -> bool:
    return isinstance(value, Integral) and not isinstance(value, bool)


def _from_seed(seed: int) -> tuple[np.random.Generator, int]:
    return seeding.np_random(seed)[0], seed
