"""CHOLMOD on kernels that suit the processor.

A distribution's OpenBLAS takes processors newer than itself for the least that it knows: Debian 12's (0.3.21) runs a Xeon of 2023 on
kernels for a Prescott of 2004, and factorises cloth in one and a half times the time. numpy brings a newer OpenBLAS, which is loaded first
and recognises more: what that one says, the other is told. A type that the user has set is never overridden.
"""

import os
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
