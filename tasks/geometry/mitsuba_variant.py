"""Mitsuba with an LLVM that works: finding the shared library, and saying which package brings it when there is none.

Dr.Jit loads libLLVM at run time, from DRJIT_LIBLLVM_PATH or by name. LLVM 15, 16 and 19 are known to work with Dr.Jit 1.5; 14 is refused
by it with a message that says the library was not found. A path that the user has set is never overridden.
"""

import os
import re
import sys
from pathlib import Path
from types import ModuleType

OLDEST_LLVM = 15
FAVOURITES = (19, 16, 15)  # tested; others newer than OLDEST_LLVM are tried after these
FOLDERS = (
    "/usr/lib/x86_64-linux-gnu",
    "/usr/lib/aarch64-linux-gnu",
    "/usr/lib64",
    "/usr/local/lib",
    "/usr/lib",
    "/opt/homebrew/opt/llvm/lib",
)


def load_mitsuba(variant: str | None = None, *, threads: int | None = None) -> ModuleType:
    """The `mitsuba` module set to `variant`; `threads` limits Dr.Jit's pool (1 makes sums, hence pictures, repeatable to the bit).

    Without `variant` the one that is set stays, and llvm_ad_rgb is set where none is: Mitsuba's variant belongs to the process, and a scene
    made under one is lost under another. Raises RuntimeError with the remedy if the variant needs LLVM and no usable one is installed.
    """
    if variant is None:
        variant = (sys.modules["mitsuba"].variant() if "mitsuba" in sys.modules else None) or "llvm_ad_rgb"
    if variant.startswith("llvm") and not os.environ.get("DRJIT_LIBLLVM_PATH"):
        os.environ["DRJIT_LIBLLVM_PATH"] = str(find_llvm())  # Dr.Jit reads it when it is imported
    import drjit
    import mitsuba

    mitsuba.set_variant(variant)
    if threads is not None:
        drjit.set_thread_count(threads)
    return mitsuba


def find_llvm(folders: tuple[str, ...] = FOLDERS) -> Path:
    """Path of the libLLVM to use. Raises RuntimeError naming the package if there is none of version 15 or newer."""
    places = [Path(folder) for folder in folders] + sorted(Path("/usr/lib").glob("llvm-*/lib"))
    found = {
        version: path for folder in reversed(places) for path in sorted(folder.glob("libLLVM*")) if (version := _version(path)) is not None
    }
    usable = [version for version in (*FAVOURITES, *sorted(found, reverse=True)) if version in found and version >= OLDEST_LLVM]
    if not usable:
        seen = f" (found only version {', '.join(map(str, sorted(found)))})" if found else ""
        raise RuntimeError(
            f"Mitsuba needs the LLVM library, version {OLDEST_LLVM} or newer{seen}. "
            "Install it with: sudo apt-get install libllvm19, or set DRJIT_LIBLLVM_PATH to the full path of a libLLVM.so."
        )
    return found[usable[0]]


def _version(path: Path) -> int | None:
    """Major version in names such as libLLVM.so.19.1, libLLVM-16.so.1, libLLVM-15.0.6.so.1."""
    match = re.fullmatch(r"libLLVM(?:-(\d+)[\d.]*?\.(?:so|dylib)[\d.]*|\.so\.(\d+)[\d.]*)", path.name)
    return int(match[1] or match[2]) if match else None
