"""What computes in parallel by itself is kept to one thread, Ipopt's own BLAS too."""

from threadpoolctl import ThreadpoolController

from space_envs.system.threads import ipopt_on_one_thread, on_one_thread


def test_ipopts_own_blas_keeps_to_one_thread() -> None:
    """It is not among the libraries that threadpoolctl knows by itself."""
    ipopt_on_one_thread()
    own = ThreadpoolController().select(internal_api="openblas_of_casadi")
    assert len(own) == 1
    for keep in (ipopt_on_one_thread, on_one_thread):
        own.limit(limits=2)
        assert [library["num_threads"] for library in own.info()] == [2]
        keep()
        assert [library["num_threads"] for library in own.info()] == [1]


def test_all_that_is_loaded_keeps_to_one_thread() -> None:
    loaded = ThreadpoolController()
    with loaded.limit(limits=2):
        on_one_thread()
        assert {library["num_threads"] for library in ThreadpoolController().info()} == {1}
