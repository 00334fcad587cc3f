"""Kernels compiled ahead are those that a run loads."""

import json
import os
import subprocess
import sys
from importlib import import_module
from inspect import signature

import pytest

from tasks.compiled_kernels import argument_types, recorded

MODULE = "tasks.simulator.potential"


@pytest.mark.parametrize("module", recorded())
def test_what_is_recorded_can_be_called_so(module):
    for name, ways in recorded()[module].items():
        kernel = getattr(import_module(module), name)
        for way in ways:
            assert len(argument_types(way)) == len(signature(kernel.py_func).parameters), f"{name}: record anew after a demo (--record)"


def test_another_process_compiles_none_of_them_again(tmp_path):
    def told(program):
        answer = subprocess.run(
            [sys.executable, "-c", program], env={**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)}, check=True, stdout=subprocess.PIPE
        )
        return json.loads(answer.stdout)

    assert told(f"from tasks.compiled_kernels import compile_kernels\nprint(compile_kernels({MODULE!r}) or 0)") == 0
    product = f"""
import json, numpy as np
from {MODULE} import Blocks, _block_product
Blocks(np.zeros((2, 3), np.int32), np.zeros((2, 9, 9))).times(np.zeros((1, 4, 3)))
print(json.dumps([len(_block_product.stats.cache_hits), len(_block_product.stats.cache_misses)]))
"""
    assert told(product) == [1, 0]
    assert told("import json\nfrom tasks.compiled_kernels import found\nprint(json.dumps(found()))") == {MODULE: recorded()[MODULE]}
