"""Work spread over processes by joblib: on this machine (loky), or on a Ray or Dask cluster."""

import logging
import os
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures.process import BrokenProcessPool
from contextlib import AbstractContextManager, contextmanager
from importlib.util import find_spec
from itertools import islice
from typing import Any

from joblib import Parallel, parallel_config

from space_envs.errors import ConfigurationError, unknown_name
from space_envs.system.processes import watch

BACKENDS = ("loky", "ray", "dask")
PATIENCE = 10.0  # s, until a cluster has to answer
GROUP = 4  # calls a process that Ray is given at a time, since its backend gives results back all at once

Spread = Callable[[Iterable[Any]], Iterator[Any]]
"""From joblib's delayed calls to their results, in the order in which they are done."""
_PACKAGES = {"ray": ("ray",), "dask": ("dask", "distributed")}


class ProcessDiedError(RuntimeError):
    """A worker process died during its work, and others may have died with it."""


def check_backend(jobs: int, name: str = "loky", address: str | None = None) -> None:
    """Reject arguments that `backend` does not support, before any work.

    Raises:
        ConfigurationError: if jobs is not positive, the backend is unknown or not installed, or an address
            is given for processes of this machine.
    """
    if jobs < 1:
        raise ConfigurationError(f"jobs must be at least 1, got {jobs}")
    if name not in BACKENDS:
        raise unknown_name("backend", name, BACKENDS)
    if name == "loky" and address is not None:
        raise ConfigurationError(
            f"backend loky runs on this machine and takes no address, got {address!r}; ray and dask do"
        )
    missing = [package for package in _PACKAGES.get(name, ()) if find_spec(package) is None]
    if missing:
        raise ConfigurationError(
            f"backend {name!r} needs {' and '.join(missing)}: pip install 'space-capture[{name}]'"
        )


@contextmanager
def backend(jobs: int, name: str = "loky", address: str | None = None) -> Iterator[Spread]:
    """Yield a function that distributes delayed calls over processes.

    Args:
        jobs: processes. name: of the backend. address: of a cluster that already runs; without one, ray and
            dask start a cluster of `jobs` processes on this machine and stop it at the end.

    The function raises ProcessDiedError if one of the processes dies. One job on this machine runs in this
    process.

    Raises:
        ConfigurationError: as `check_backend`, or if nothing answers at the address.
    """
    check_backend(jobs, name, address)
    if name == "ray":
        from ray.exceptions import RayError

        with _ray(jobs, address):
            yield lambda calls: _watched(_in_groups(jobs, calls), RayError)
    elif name == "dask":
        from distributed import KilledWorker

        with _dask(jobs, address):
            yield lambda calls: _watched(_at_once(jobs, calls), KilledWorker)
    else:
        with here():
            yield lambda calls: _watched(_at_once(jobs, calls), BrokenProcessPool)


def elsewhere(call: Any) -> Any:
    """The result of a delayed call, in another process of this machine, which the next call finds again.

    Raises:
        ProcessDiedError: if that process dies. Any error of the call.
    """
    with here():  # of two, since one job is done in this process
        (result,) = _watched(_at_once(2, [call]), BrokenProcessPool)
    return result


def _watched(results: Iterator[Any], death: type[Exception]) -> Iterator[Any]:
    try:
        yield from results
    except death as error:
        raise ProcessDiedError(_first_line(error)) from error


def here() -> AbstractContextManager[Any]:
    """joblib's processes of this machine, which end with this one, however it ends."""
    return parallel_config(backend="loky", initializer=watch, initargs=(os.getpid(),))


def _at_once(jobs: int, calls: Iterable[Any]) -> Iterator[Any]:
    spread: Any = Parallel(n_jobs=jobs, return_as="generator_unordered")
    return spread(calls)


def _in_groups(jobs: int, calls: Iterable[Any]) -> Iterator[Any]:
    calls = iter(calls)
    while group := list(islice(calls, GROUP * jobs)):
        yield from Parallel(n_jobs=jobs)(group)


@contextmanager
def _ray(jobs: int, address: str | None) -> Iterator[None]:
    import ray
    from ray.util.joblib import register_ray

    quiet: dict[str, Any] = {"logging_level": logging.ERROR, "log_to_driver": False}
    try:
        if address is None:
            ray.init(num_cpus=jobs, include_dashboard=False, **quiet)
        else:
            ray.init(address=address, **quiet)
    except (ConnectionError, ValueError, RuntimeError, TimeoutError) as error:
        message = f"no Ray cluster answers at {address}: {_first_line(error)}"
        raise ConfigurationError(f"{message} (one that wants a token needs RAY_AUTH_MODE=token)") from None
    try:
        register_ray()
        with parallel_config(backend="ray"):
            yield
    finally:
        ray.shutdown()  # a cluster that ran before goes on


@contextmanager
def _dask(jobs: int, address: str | None) -> Iterator[None]:
    from distributed import Client, LocalCluster

    cluster = None
    if address is None:
        quiet: dict[str, Any] = {"dashboard_address": None, "silence_logs": logging.ERROR}
        cluster = LocalCluster(n_workers=jobs, threads_per_worker=1, **quiet)
    try:
        client = Client(address if cluster is None else cluster, timeout=PATIENCE)
    except (OSError, ValueError) as error:
        raise ConfigurationError(f"no Dask cluster answers at {address}: {_first_line(error)}") from None
    try:
        with parallel_config(backend=_dask_backend(client)):
            yield
    finally:
        client.close()
        if cluster is not None:
            cluster.close()


def _dask_backend(client: Any) -> Any:
    """joblib's own, which would wait for ever for a call whose worker died."""
    from joblib._dask import DaskDistributedBackend

    class Backend(DaskDistributedBackend):
        def submit(self, func: Any, callback: Any = None) -> Any:
            future = super().submit(func, callback)
            future.add_done_callback(lambda done: done.exception() and callback(done.exception()))
            return future

        def retrieve_result_callback(self, out: Any) -> Any:
            if isinstance(out, Exception):
                raise out
            return super().retrieve_result_callback(out)

    return Backend(client=client)


def _first_line(error: BaseException) -> str:
    return (str(error).splitlines() or [type(error).__name__])[0]
