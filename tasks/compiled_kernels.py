"""Compiles numba's kernels ahead of the first run, for the types that a run calls them with.

`make setup` does so (`python -m tasks.compiled_kernels`); numba keeps what was compiled beside each file. The types stand in
`compiled_kernels.json`, in numba's own notation; `--record` writes there what the kernels of this checkout have been compiled for, after a
demo. A kernel or a type that is missing there is compiled when it is first called.
"""

import json
import os
import sys
from concurrent.futures import ProcessPoolExecutor
from importlib import import_module
from multiprocessing import get_context
from pathlib import Path

from numba import types
from numba.core.caching import NullCache
from numba.core.dispatcher import Dispatcher

TASKS = Path(__file__).parent
RECORD = TASKS / "compiled_kernels.json"


def recorded() -> dict[str, dict[str, list[str]]]:
    """Module -> kernel -> types of its arguments, once for each way it is called."""
    return json.loads(RECORD.read_text())


def argument_types(notation: str) -> tuple[types.Type, ...]:
    """The types that numba prints so."""
    return eval(notation, {"__builtins__": {}}, vars(types))


def compile_kernels(module: str) -> None:
    """Compile what is recorded of a module."""
    kernels = import_module(module)
    for name, ways in recorded()[module].items():
        for notation in ways:
            getattr(kernels, name).compile(argument_types(notation))


def found() -> dict[str, dict[str, list[str]]]:
    """What the kernels of this checkout have been compiled for, as numba's files beside them say; inner ones come with those around them."""
    record = {}
    for file in sorted(TASKS.rglob("*.py")):
        if file == Path(__file__) or "njit(" not in file.read_text():
            continue
        module = ".".join(file.relative_to(TASKS.parent).with_suffix("").parts)
        kernels = {
            name: v for name, v in vars(import_module(module)).items() if isinstance(v, Dispatcher) and v.py_func.__module__ == module
        }
        ways = {name: _kept(kernel) for name, kernel in sorted(kernels.items())}
        if any(ways.values()):
            record[module] = {name: notations for name, notations in ways.items() if notations}
    return record


def _kept(kernel: Dispatcher) -> list[str]:
    """Types in numba's notation; without those known to the compiler by value, as only other kernels call them."""
    if isinstance(kernel._cache, NullCache):
        return []
    return sorted(way for way in (repr(key[0]) for key in kernel._cache._cache_file._load_index()) if "Literal" not in way)


def main() -> None:
    """Compile all, or record what is."""
    if "--record" in sys.argv[1:]:
        RECORD.write_text(json.dumps(found(), indent=1) + "\n")
        return
    with ProcessPoolExecutor(os.cpu_count(), mp_context=get_context("spawn")) as pool:
        list(pool.map(compile_kernels, recorded()))


if __name__ == "__main__":
    main()
