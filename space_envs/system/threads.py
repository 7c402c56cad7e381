"""Limit libraries with their own threads to one: BLAS, OpenMP, Ipopt's BLAS and torch.

The matrices here are small, and threads that wait for each other cost more than they save: Ipopt is two to
four times slower with two of them where the second core is busy.
"""

import sys

import threadpoolctl
from threadpoolctl import ThreadpoolController, threadpool_limits


class _IpoptBlas(threadpoolctl.OpenBLASController):
    """CasADi brings an OpenBLAS of its own for Ipopt, under a name that threadpoolctl does not look for."""

    internal_api = "openblas_of_casadi"
    filename_prefixes = ("libcasadi-tp-openblas",)


threadpoolctl.register(_IpoptBlas)


def ipopt_on_one_thread() -> None:
    """Load CasADi's Ipopt and limit it to one thread; other libraries are not changed."""
    import casadi as ca

    if not _ipopt():
        ca.load_nlpsol("ipopt")  # twice, it warns
    _ipopt().limit(limits=1)


def on_one_thread() -> None:
    """Limit all loaded libraries to one thread."""
    if "casadi" in sys.modules:
        ipopt_on_one_thread()
    threadpool_limits(1)
    torch = sys.modules.get("torch")
    if torch is not None:
        torch.set_num_threads(1)


def _ipopt() -> ThreadpoolController:
    return ThreadpoolController().select(internal_api=_IpoptBlas.internal_api)
