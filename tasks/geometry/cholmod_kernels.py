"""CHOLMOD on kernels and threads that suit the processor.

A distribution's OpenBLAS takes processors newer than itself for the least that it knows: Debian 12's (0.3.21) runs a Xeon of 2023 on
kernels for a Prescott of 2004, and factorises cloth in one and a half times the time. numpy brings a newer OpenBLAS, which is loaded first
and recognises more: what that one says, the other is told. A type that the user has set is never overridden.

CHOLMOD itself opens four OpenMP threads around every loop of a factorisation, however short (`num_threads` in its source, which
OMP_NUM_THREADS does not reach). They wait for one another three to six times as long as the factorisation of cloth takes; see `one_thread`.
"""

import ctypes
import os
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from types import ModuleType

import numpy  # noqa: F401  its OpenBLAS is to be there when we ask
from threadpoolctl import threadpool_info

CORE = "OPENBLAS_CORETYPE"  # read once, when the library is loaded


def load_cholmod() -> ModuleType:
    """The module `sksparse.cholmod`. Raises ImportError where it is not installed."""
    recognised = [library["architecture"] for library in threadpool_info() if library.get("architecture")]
    if recognised:
        os.environ.setdefault(CORE, recognised[0])
    from sksparse import cholmod

    return cholmod


@contextmanager
def one_thread() -> Iterator[None]:
    """Within, CHOLMOD called from this thread factorises without OpenMP. Other threads and libraries keep theirs; same bits."""
    library = openmp()
    if library is None:
        yield
        return
    levels = library.omp_get_max_active_levels()
    library.omp_set_max_active_levels(0)  # no parallel region is active, whatever number of threads it asks for
    try:
        yield
    finally:
        library.omp_set_max_active_levels(levels)


@cache
def openmp() -> ctypes.CDLL | None:
    """The OpenMP that CHOLMOD is linked against; None where it has none."""
    library = ctypes.CDLL(load_cholmod().__file__)  # a name is looked up in what it is linked against, too
    return library if hasattr(library, "omp_set_max_active_levels") else None
