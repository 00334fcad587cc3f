"""A whole motion in one file: NPZ, which `physavatar gap run` reads back, or PC2, which animation programs attach to a mesh.

NPZ holds `vertices [T, V, 3] m`, `faces [F, 3]`, `fps` and whatever else the interface "tracked geometry" names.
PC2: 32 bytes of header, then T·V float32 triples. Blender and 3ds Max lay it over a mesh with the same vertices in the same order.

Source: the PC2 layout as in Blender's `io_export_pc2`: "POINTCACHE2\\0", version 1, points, start frame, sampling rate, samples.
Limits: PC2 has no seconds and no axes; set the frame rate and y-up where it is loaded.
"""

import struct
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

PC2_VERSION, START_FRAME, FRAMES_PER_SAMPLE = 1, 0.0, 1.0


def write_npz(path: Path, vertices: NDArray, faces: NDArray, *, fps: float, **more: Any) -> Path:
    """Writes vertices [T, V, 3] m, faces [F, 3] and `more`, such as collider_vertices, boundary, noise_m, mass_kg."""
    content: dict[str, Any] = {"vertices": vertices.astype("f4"), "faces": faces.astype("i4"), "fps": float(fps), "up": "y"}
    np.savez_compressed(path, **content, **more)
    return path


def write_pc2(path: Path, vertices: NDArray) -> Path:
    """Writes vertices [T, V, 3] m."""
    frames, points, _ = vertices.shape
    header = struct.pack("<12siiffi", b"POINTCACHE2\0", PC2_VERSION, points, START_FRAME, FRAMES_PER_SAMPLE, frames)
    path.write_bytes(header + np.ascontiguousarray(vertices, "<f4").tobytes())
    return path
