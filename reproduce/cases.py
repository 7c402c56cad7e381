"""Random cases of a study, computed in parallel, each stored as a line of JSON as soon as it is done.

A run that was stopped goes on where it was. Lines belong to a key, the hash of all that decides a result, so
that results of other settings or other code are never mixed in.
"""

import hashlib
import json
import os
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, cast

from joblib import Parallel, delayed
from threadpoolctl import threadpool_limits
from tqdm import tqdm

from space_envs.errors import ConfigurationError
from space_envs.system.parallel import here

CaseRecord = dict[str, Any]


def source_digest(paths: Iterable[Path]) -> str:
    """Hash of the Python sources at or under the paths: results of code that has changed since are stale."""
    digest = hashlib.sha256()
    for path in paths:
        for file in sorted(path.rglob("*.py")) if path.is_dir() else [path]:
            digest.update(file.name.encode("utf-8") + b"\0" + file.read_bytes() + b"\0")
    return digest.hexdigest()


def read_cases(path: Path) -> dict[int, CaseRecord]:
    """Records by index. A line that was not written to its end, or is no record, is passed over."""
    if not path.exists():
        return {}
    records: dict[int, CaseRecord] = {}
    for line in path.read_bytes().split(b"\n"):
        try:
            record = json.loads(line)
        except ValueError:
            continue
        if isinstance(record, dict) and type(record.get("index")) is int:
            records[record["index"]] = record
    return records


def run_cases(
    work: Callable[[int], CaseRecord], count: int, path: Path, jobs: int = 1, progress: bool = False
) -> list[CaseRecord]:
    """Records of cases 0 to count - 1, in order; those that `path` holds are not computed again.

    Args:
        work: the record of a case from its index alone: a plain JSON object with `index` in it. It has to be
            picklable where jobs > 1, and its result must not depend on anything else.
        path: JSON lines; one is appended, and forced onto the disk, whenever a case is done.
        jobs: processes. progress: show a bar.

    Raises:
        ConfigurationError: for a count or jobs that is not positive, or a folder that cannot be written.
    """
    for name, value in (("count", count), ("jobs", jobs)):
        if isinstance(value, bool) or not isinstance(value, int) or value < 1:
            raise ConfigurationError(f"{name} must be a positive integer, got {value!r}")
    records = read_cases(path)
    missing = [index for index in range(count) if index not in records]
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        file = path.open("ab")
    except OSError as error:
        raise ConfigurationError(f"cannot write to {path.parent}: {error.strerror}") from None
    shown = tqdm(total=count, initial=count - len(missing), unit="case", disable=not progress)
    with file, here(), shown as bar:
        # A line that was cut off gets an end of its own, so that it spoils no other.
        if file.tell() and not path.read_bytes().endswith(b"\n"):
            file.write(b"\n")
        calls = (delayed(_computed)(work, index) for index in missing)
        parallel = Parallel(n_jobs=min(jobs, len(missing) or 1), return_as="generator_unordered")
        for record in cast(Iterable[CaseRecord], parallel(calls)):
            line = json.dumps(record, allow_nan=False)
            file.write(line.encode("utf-8") + b"\n")
            file.flush()
            os.fsync(file.fileno())
            records[record["index"]] = json.loads(line)
            bar.update()
    return [records[index] for index in range(count)]


def _computed(work: Callable[[int], CaseRecord], index: int) -> CaseRecord:
    with threadpool_limits(1):  # several threads of BLAS give other bits
        return work(index)
