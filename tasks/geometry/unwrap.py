"""A UV atlas for templates that come without one, by xatlas (Young 2018; charts grown as in Sander et al. 2001, LSCM parametrisation).

Charts are packed at one texel density for the whole mesh, with room for the gutters that a texture of this size wants around them
(`appearance/atlas.py`). The result is deterministic.
Limits: charts follow geometry, not garment panels; seams are many (10 charts for a tube and a cone, dozens for a body).
"""

import numpy as np
from numpy.typing import NDArray

PADDING = 6  # [texel] two gutters


def unwrap(vertices: NDArray, faces: NDArray[np.int32], *, texture_size: int = 512) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
    """uv_vertices [U, 2] in [0, 1]² and uv_faces [F, 3] for a mesh (vertices [V, 3] m, faces [F, 3]) and a square texture.

    Face order is kept and UV triangles keep their shape: one texel has the same size everywhere up to the charts' distortion.
    """
    import xatlas

    atlas = xatlas.Atlas()
    atlas.add_mesh(np.ascontiguousarray(vertices, np.float32), np.ascontiguousarray(faces, np.uint32))
    packing = xatlas.PackOptions()
    packing.resolution, packing.padding, packing.bilinear = texture_size, PADDING, True
    atlas.generate(pack_options=packing)
    _, uv_faces, uv = atlas[0]
    # xatlas scales each axis to its own extent; the longer one must set the scale for both, or texels are not square
    return uv.astype(float) * [atlas.width, atlas.height] / max(atlas.width, atlas.height), uv_faces.astype(np.int32)
