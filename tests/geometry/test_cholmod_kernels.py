"""CHOLMOD's BLAS runs on the kernels that numpy's recognises, or on those that the user names; its OpenMP on one thread, for us alone."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
FACTORISED = """
import os
from scipy.sparse import csc_matrix, diags, eye, kron, kronsum
from tasks.geometry.cholmod_kernels import load_cholmod, one_thread, openmp
line = diags([-1, 2.1, -1], [-1, 0, 1], shape=(30, 30))
matrix = csc_matrix(kron(kronsum(line, line), eye(3)))
symbolic = load_cholmod().analyze(matrix, mode="supernodal")
with one_thread():
    inside = symbolic.cholesky(matrix)
print(len(os.listdir("/proc/self/task")))
before = openmp().omp_get_max_active_levels() if openmp() else 1
outside = symbolic.cholesky(matrix)
print(len(os.listdir("/proc/self/task")))
print(before, (inside.L() != outside.L()).nnz)
"""
ASKED = """
import json
from tasks.geometry.cholmod_kernels import load_cholmod
load_cholmod()
from threadpoolctl import threadpool_info
print(json.dumps([(i["filepath"], i["architecture"]) for i in threadpool_info() if i["internal_api"] == "openblas"]))
"""


def architectures(**environment: str) -> dict[bool, set[str]]:
    """Whether it is numpy's or scipy's own -> architectures, in a process of its own."""
    kept = {k: v for k, v in os.environ.items() if k != "OPENBLAS_CORETYPE"}
    ended = subprocess.run([sys.executable, "-c", ASKED], cwd=ROOT, env=kept | environment, capture_output=True, text=True, check=True)
    found: dict[bool, set[str]] = {True: set(), False: set()}
    for path, architecture in json.loads(ended.stdout):
        found[".libs" in path].add(architecture)
    if not found[False]:
        pytest.skip("scikit-sparse is not linked against an OpenBLAS of the system")
    return found


def test_both_run_on_the_same_kernels():
    found = architectures()
    assert found[False] == found[True]


def test_what_the_user_names_is_kept():
    assert architectures(OPENBLAS_CORETYPE="Nehalem")[False] == {"Nehalem"}


def test_a_factorisation_opens_no_threads_and_leaves_openmp_as_it_was():
    ended = subprocess.run([sys.executable, "-c", FACTORISED], cwd=ROOT, capture_output=True, text=True, check=True)
    inside, outside, levels, differing = (int(word) for word in ended.stdout.split())
    if outside == 1:
        pytest.skip("CHOLMOD is not built with OpenMP here")
    assert (inside, differing) == (1, 0)
    assert levels > 0
