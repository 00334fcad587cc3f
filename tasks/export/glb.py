"""The binary container of glTF 2.0: a JSON chunk and one buffer that its accessors look into.

Source: Khronos glTF 2.0 specification, sections 3.6 (binary data) and 4.4 (GLB).
"""

import json
import struct
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

FLOAT, UNSIGNED_BYTE, UNSIGNED_SHORT, UNSIGNED_INT = 5126, 5121, 5123, 5125
COMPONENT = {"f4": FLOAT, "u1": UNSIGNED_BYTE, "u2": UNSIGNED_SHORT, "u4": UNSIGNED_INT}
SHAPE = {(): "SCALAR", (2,): "VEC2", (3,): "VEC3", (4,): "VEC4", (4, 4): "MAT4"}
VERTICES, INDICES = 34962, 34963  # what a buffer view is bound as


class Glb:
    """A glTF document (`json`) with the buffer it grows as arrays are added."""

    def __init__(self) -> None:
        self.json: dict[str, Any] = {"asset": {"version": "2.0", "generator": "physavatar"}, "accessors": [], "bufferViews": []}
        self.binary = bytearray()

    def view(self, content: bytes, *, bound_as: int | None = None) -> int:
        """Appends bytes; the number of their buffer view."""
        self.binary += bytes(-len(self.binary) % 4)
        view = {"buffer": 0, "byteOffset": len(self.binary), "byteLength": len(content)}
        self.json["bufferViews"].append(view | ({"target": bound_as} if bound_as else {}))
        self.binary += content
        return len(self.json["bufferViews"]) - 1

    def accessor(self, values: NDArray, dtype: str, *, bound_as: int | None = None, limits: bool = False) -> int:
        """Appends `values` [item, …] as little-endian `dtype`; the number of their accessor. `limits` adds min and max."""
        values = np.ascontiguousarray(values, f"<{dtype}")
        if values.ndim == 3:
            values = np.swapaxes(values, 1, 2)  # matrices go by columns
        accessor = {
            "bufferView": self.view(values.tobytes(), bound_as=bound_as),
            "componentType": COMPONENT[dtype],
            "count": len(values),
            "type": SHAPE[values.shape[1:]],
        }
        if limits:
            accessor |= {"min": np.atleast_1d(values.min(axis=0)).tolist(), "max": np.atleast_1d(values.max(axis=0)).tolist()}
        self.json["accessors"].append(accessor)
        return len(self.json["accessors"]) - 1

    def add(self, kind: str, item: dict[str, Any]) -> int:
        """Appends to a top-level list such as "nodes"; the number of the item."""
        self.json.setdefault(kind, []).append(item)
        return len(self.json[kind]) - 1

    def write(self, path: Path) -> None:
        """Writes the .glb file."""
        self.binary += bytes(-len(self.binary) % 4)
        document = json.dumps(self.json | {"buffers": [{"byteLength": len(self.binary)}]}, separators=(",", ":"), allow_nan=False).encode()
        document += b" " * (-len(document) % 4)
        chunks = struct.pack("<I4s", len(document), b"JSON") + document + struct.pack("<I4s", len(self.binary), b"BIN\0") + self.binary
        path.write_bytes(struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks)
