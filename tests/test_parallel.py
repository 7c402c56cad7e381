"""Work spread over processes: refused where it cannot be done, given back as it is done."""

import time

import pytest
from joblib import delayed

from space_envs.errors import ConfigurationError
from space_envs.system.parallel import backend, check_backend


def test_backends_that_cannot_be_are_refused() -> None:
    for jobs, name, address, message in (
        (0, "loky", None, "jobs must be at least 1"),
        (1, "lokey", None, "Did you mean 'loky'"),
        (1, "loky", "localhost:1", "takes no address"),
    ):
        with pytest.raises(ConfigurationError, match=message):
            check_backend(jobs, name, address)


def test_an_address_that_nobody_answers_at_is_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("distributed")
    monkeypatch.setattr("space_envs.system.parallel.PATIENCE", 0.5)
    with pytest.raises(ConfigurationError, match="no Dask cluster answers at tcp://127.0.0.1:9"):
        with backend(2, "dask", "tcp://127.0.0.1:9"):
            pytest.fail("there is no cluster")


def test_results_come_as_they_are_done() -> None:
    def wait(seconds: float) -> float:
        time.sleep(seconds)
        return seconds

    with backend(2) as spread:
        assert sorted(spread(delayed(wait)(s) for s in (0.2, 0.0, 0.1))) == [0.0, 0.1, 0.2]
