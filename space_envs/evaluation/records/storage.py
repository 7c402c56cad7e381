"""Files of records: JSON lines, read with every line checked."""

from collections.abc import Iterable
from pathlib import Path

from space_envs.errors import ConfigurationError
from space_envs.evaluation.records.episode import EpisodeRecord
from space_envs.system.files import atomic_write_text
from space_envs.system.reading import read_bytes


def write_records(path: str | Path, records: Iterable[EpisodeRecord]) -> None:
    """Write one JSON line for each record; a reader sees the whole file or none of it."""
    atomic_write_text(path, "".join(record.to_json() + "\n" for record in records))


def read_records(path: str | Path) -> list[EpisodeRecord]:
    """Read a file of JSON lines. Raises ConfigurationError that names file, line and mistake."""
    path = Path(path)
    try:
        # Bytes are split at line feeds alone: str.splitlines also splits at U+2028, which JSON allows.
        lines = read_bytes(path).split(b"\n")
    except (OSError, ConfigurationError) as error:
        raise ConfigurationError(f"{path}: cannot be read: {error}") from error
    if lines[-1] != b"":
        raise ConfigurationError(f"{path}:{len(lines)}: the last line has no end; the file was cut short")
    records = []
    for number, line in enumerate(lines[:-1], start=1):
        try:
            records.append(EpisodeRecord.from_json(line.decode("utf-8")))
        except (ConfigurationError, UnicodeDecodeError) as error:
            raise ConfigurationError(f"{path}:{number}: {error}") from error
    return records
