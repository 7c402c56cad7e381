"""Tables of a description file: each value read once, checked, with errors that say where it stands."""

import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from space_envs.checks import finite_array, flag, number
from space_envs.errors import ConfigurationError, positive, shown, unknown_name

_MISSING = object()
LARGEST_FILE = 10_000_000  # bytes of a description


class DescriptionTable:
    """A table of a TOML file.

    Args:
        values: its keys and values. file: that it stands in. name: of the table, as in `[satellite]`; empty
            for the top level.
        keys: valid keys.

    Raises:
        ConfigurationError: for an unknown key, with the nearest valid one.
    """

    def __init__(self, values: Any, file: Path, name: str, keys: Sequence[str]) -> None:
        self.file, self.name = file, name
        if not isinstance(values, Mapping):
            raise self.error(f"must be a table, got {shown(values)}")
        self._values = values
        for key in values:
            if key not in keys:
                raise self.error(str(unknown_name("key", key, keys)))

    def error(self, problem: str) -> ConfigurationError:
        """Error that names the file and the table."""
        where = f"{self.file}: [{self.name}]" if self.name else f"{self.file}:"
        return ConfigurationError(f"{where} {problem}")

    def __contains__(self, key: str) -> bool:
        return key in self._values

    def get(self, key: str, default: Any = _MISSING, hint: str = "") -> Any:
        """Value of a key as it is, or the default."""
        if key in self._values:
            return self._values[key]
        if default is _MISSING:
            raise self.error(f"lacks {key!r}{hint}")
        return default

    def text(self, key: str, default: Any = _MISSING) -> Any:
        """Text of a key that is not empty, or the default."""
        value = self.get(key, default)
        if key in self._values and (not isinstance(value, str) or not value.strip()):
            raise self.error(f"{key} must be a text, got {shown(value)}")
        return value

    def flag(self, key: str, default: bool) -> bool:
        """True or false."""
        return self._checked(flag, key, self.get(key, default))

    def positive(self, key: str, default: Any = _MISSING, hint: str = "") -> Any:
        """Positive number of a key, or the default."""
        value = self.get(key, default, hint)
        return self._checked(positive, key, value) if key in self._values else value

    def number(self, key: str, default: Any = _MISSING) -> Any:
        """Finite number of a key, or the default."""
        value = self.get(key, default)
        return self._checked(number, key, value) if key in self._values else value

    def vector(self, key: str, length: int, default: Any = _MISSING) -> Any:
        """Tuple of finite numbers of a key, or the default."""
        value = self.get(key, default)
        if key not in self._values:
            return value
        return tuple(self._checked(finite_array, key, value, (length,)).tolist())

    def moments(self, key: str) -> tuple[float, float, float]:
        """Principal inertia of a key, kg m^2.

        Raises:
            ConfigurationError: if it is not positive or breaks the triangle inequality.
        """
        moments = self.vector(key, 3)
        low, middle, high = sorted(moments)
        if not low > 0.0:
            raise self.error(f"{key} must be positive, got {list(moments)} kg m^2")
        if high > (low + middle) * (1.0 + 1e-9):
            raise self.error(
                f"{key} breaks the triangle inequality: no body has principal moments {list(moments)} "
                "kg m^2, since each is at most the sum of the others"
            )
        return moments

    def table(self, key: str, keys: Sequence[str], default: Any = _MISSING) -> "DescriptionTable":
        """DescriptionTable within this one."""
        name = f"{self.name}.{key}" if self.name else key
        return DescriptionTable(self.get(key, default), self.file, name, keys)

    def tables(self, key: str, keys: Sequence[str]) -> list["DescriptionTable"]:
        """List of tables within this one, such as `[[arm]]`."""
        values = self.get(key, [])
        if not isinstance(values, list):
            hint = "" if self.name else f": write [[{key}]]"
            raise self.error(f"{key} must be a list of tables, got {shown(values)}{hint}")
        name = f"{self.name}.{key}" if self.name else key
        return [
            DescriptionTable(value, self.file, f"{name} {n}", keys) for n, value in enumerate(values, start=1)
        ]

    def _checked(self, check: Any, key: str, value: Any, *more: Any) -> Any:
        try:
            return check(key, value, *more)
        except ConfigurationError as error:
            raise self.error(str(error)) from None


def read_toml(file: Path) -> dict[str, Any]:
    """Content of a TOML file.

    Raises:
        ConfigurationError: if it cannot be read or is no TOML.
    """
    try:
        if file.stat().st_size > LARGEST_FILE:
            raise ConfigurationError(
                f"{file} has over {LARGEST_FILE} bytes, which is no description of a robot"
            )
        return tomllib.loads(file.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise ConfigurationError(f"there is no file {str(file)!r}") from None
    except OSError as error:
        raise ConfigurationError(f"{file} cannot be read: {error.strerror or error}") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ConfigurationError(f"{file} is no valid TOML: {error}") from None


def merged(base: Mapping[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    """Tables with the changes of a variant; in lists of tables, the first changes the first, and so on."""
    result = dict(base)
    for key, value in changes.items():
        old = base.get(key)
        if isinstance(value, Mapping) and isinstance(old, Mapping):
            result[key] = merged(old, value)
        elif old is not None and _tables(value) and _tables(old) and len(value) == len(old):
            result[key] = [merged(one, other) for one, other in zip(old, value, strict=True)]
        else:
            result[key] = value
    return result


def _tables(value: Any) -> bool:
    return isinstance(value, list) and bool(value) and all(isinstance(part, Mapping) for part in value)
