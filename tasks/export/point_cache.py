"""A whole motion in one file: NPZ, which `physavatar gap run` reads back.

It holds `vertices [T, V, 3] m`, `faces [F, 3]`, `fps` and whatever else the interface "tracked geometry" names.
"""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray


def write_npz(path: Path, vertices: NDArray, faces: NDArray, *, fps: float, **more: Any) -> Path:
    """Writes vertices [T, V, 3] m, faces [F, 3] and `more`, such as collider_vertices, boundary, noise_m, mass_kg."""
    content: dict[str, Any] = {"vertices": vertices.astype("f4"), "faces": faces.astype("i4"), "fps": float(fps), "up": "y"}
    np.savez_compressed(path, **content, **more)
    return path
