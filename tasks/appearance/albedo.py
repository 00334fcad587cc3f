"""Diffuse albedo in closed form: with geometry known, a pixel is linear in the texture.

For transport fixed, Î = M ρ (`pixels.py`), and per colour channel

    (MᵀM + λ L + ε I) ρ = Mᵀ y + ε ½          L joins texels of the same chart only

is solved by conjugate gradients; texels that no image determines are filled over the surface (`unseen.py`). Transport depends on ρ
through interreflection alone (`radiosity.py`), so two passes suffice: grey, then with the texture just found. Replaces the 2000 Adam
steps of PhysAvatar supplement A.4 (`inverse_rendering.py` holds them).

Gauge: only albedo × light is observed, up to interreflection, so L_a = 1 in every channel (the supplement's start value) and the
texture takes up the rest. With `fit_gain` each camera and channel has a gain (`camera_gain.py`), of geometric mean 1 over those in the fit.
Limits: diffuse, constant light from everywhere, two-sided opaque surfaces, no light but what the mesh itself does not block.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tasks.appearance.atlas import chart_of_texels
from tasks.appearance.camera_gain import COARSE, camera_gains
from tasks.appearance.likeness import score_views
from tasks.appearance.observations import Images, Masks, camera_faults, observe
from tasks.appearance.pixels import NormalEquations, View
from tasks.appearance.scene import Scene, scene_faults
from tasks.appearance.transport import RAYS
from tasks.appearance.unseen import fill_unseen
from tasks.geometry.cameras import Cameras
from tasks.geometry.faults import Fault, refuse

Array = NDArray[np.float64]
Faces = NDArray[np.int32]

SMOOTHNESS, PRIOR = 0.05, 1e-4  # λ and ε, in squared pixel values per squared albedo
OBSERVED = 0.05  # least diagonal of MᵀM of a texel that the images determine
DARKEST, BRIGHTEST = 0.001, 0.999
LEFT_OUT = 0.2  # largest share of pixels that may span too many texels
ITERATIONS, TOLERANCE = 60, 1e-5  # of conjugate gradients


@dataclass(frozen=True)
class Appearance:
    """A texture and how well it explains the images.

    albedo [h, w, 3] linear; observed [h, w]: texels that images determine, the others are filled in; light [3] = L_a;
    gain [camera, 3]; psnr [frame, camera] dB over observed, eroded pixels in sRGB (NaN where none); held_out [camera]; too_fine: the
    texture is so fine that more than a fifth of the pixels were left out; ending.
    """

    albedo: NDArray[np.float32]
    observed: NDArray[np.bool_]
    light: Array
    gain: Array
    psnr: Array
    held_out: NDArray[np.bool_]
    too_fine: bool
    ending: str


def solve_albedo(
    images: Images,
    masks: Masks,
    cameras: Cameras,
    vertices: Array,
    faces: Faces,
    uv_vertices: Array,
    uv_faces: Faces,
    *,
    frames: Sequence[int],
    texture_size: tuple[int, int] = (1024, 1024),
    held_out: Sequence[int] = (),
    reduce: int = 1,
    rays: int = RAYS,
    passes: int = 2,
    fit_gain: bool = False,
    seed: int = 0,
) -> Appearance:
    """Texture of a moving mesh from its images.

    images(frame, camera) and masks(frame, camera) give 8-bit sRGB and matte; vertices [T, V, 3] m over all frames, of which `frames`
    are used; uv_vertices [U, 2] with faces of their own uv_faces [F, 3]; texture_size is (height, width). The cameras `held_out` do
    not enter the fit but are scored. `reduce` shrinks images by a whole factor. The mesh must hold everything that blocks light, the
    body under the garment included. Raises BadInput.
    """
    faults = camera_faults(cameras, reduce) + held_out_faults(cameras, held_out)
    refuse(faults + scene_faults(vertices[list(frames)], faces, uv_vertices, uv_faces))
    scene = Scene(vertices[list(frames)], faces, uv_vertices, uv_faces, cameras.scaled(1 / reduce))
    hits = scene.trace(rays=rays, seed=seed)
    train = [k for k in range(len(cameras)) if k not in set(held_out)]
    chart = chart_of_texels(uv_vertices, uv_faces, texture_size)
    ρ = np.full((*texture_size, 3), 0.5, np.float32)
    gain = np.ones((len(cameras), 3))
    if fit_gain:
        gain = camera_gains(_pictures(scene, scene.light(hits, ρ), images, masks, frames, train, reduce, COARSE), len(cameras))
    for _ in range(passes):
        equations = NormalEquations(texture_size)
        for k, view, image, usable in _pictures(scene, scene.light(hits, ρ), images, masks, frames, train, reduce, texture_size):
            equations.add(view, (image / gain[k]).astype(np.float32), usable)
        observed = equations.diagonal().min(-1) > OBSERVED
        ρ, told = _solve(equations, chart, ρ)
        ρ = fill_unseen(ρ, observed, faces, uv_vertices, uv_faces, vertices.shape[1])
    light = scene.light(hits, ρ)
    scores = score_views(scene, light, ρ, observed, images, masks, frames=frames, reduce=reduce, gain=gain)
    judges = np.isin(np.arange(len(cameras)), list(held_out))
    return Appearance(ρ, observed, np.ones(3), gain, scores, judges, _too_fine(equations), _ending(equations, observed, chart, told))


def conjugate_gradients(equations: NormalEquations, b: NDArray, x: NDArray, free: NDArray[np.bool_]) -> tuple[NDArray, float]:
    """x [h, w, 3] with (MᵀM) x = b at the `free` texels [h, w], each channel apart, and the relative residual reached.

    Preconditioned by the diagonal.
    """
    free3 = free[..., None]
    inverse_diagonal = np.where(free3, 1 / np.maximum(equations.diagonal(), 1e-12), 0)
    r = np.where(free3, b - equations.times(x), 0)
    z = inverse_diagonal * r
    p, rz = z, _dot(r, z)
    norm = np.maximum(_dot(b, inverse_diagonal * b), 1e-30)
    for _ in range(ITERATIONS):
        if (rz <= TOLERANCE**2 * norm).all():
            break
        q = equations.times(p)
        α = rz / np.maximum(_dot(p, q), 1e-30)
        x, r = x + (α * p).astype(np.float32), r - α * q
        z = inverse_diagonal * r
        rz, before = _dot(r, z), rz
        p = (z + rz / np.maximum(before, 1e-30) * p).astype(np.float32)
    return x, float(np.sqrt((rz / norm).max()))


def held_out_faults(cameras: Cameras, held_out: Sequence[int]) -> list[Fault]:
    """Judges that are no camera of the rig."""
    count = len(cameras)
    return [Fault("held_out", f"camera {k} of a rig of {count}", f"Name one of 0 to {count - 1}.") for k in held_out if not 0 <= k < count]


def _pictures(scene, light, images, masks, frames, train, reduce, size) -> Iterator[tuple[int, View, NDArray, NDArray]]:
    """(camera, view for a texture of `size`, linear image, usable pixels) of every training picture."""
    for i, frame in enumerate(frames):
        for k in train:
            yield k, scene.view(i, k, light[i], size), *observe(images, masks, frame, k, reduce=reduce)


def _solve(equations: NormalEquations, chart: NDArray[np.int32], ρ: NDArray) -> tuple[NDArray[np.float32], str]:
    free = chart >= 0
    equations.add_laplacian(chart, SMOOTHNESS)
    equations.diagonal()[free] += PRIOR
    b = equations.Mty + np.where(free[..., None], np.float32(PRIOR / 2), 0)
    x, residual = conjugate_gradients(equations, b, ρ, free)
    return np.clip(x, DARKEST, BRIGHTEST), f"linear solve to a relative residual of {residual:.0e}"


def _dot(a: NDArray, b: NDArray) -> Array:
    return np.einsum("ijc,ijc->c", a, b, dtype=np.float64)


def _too_fine(equations: NormalEquations) -> bool:
    return equations.left_out > LEFT_OUT * max(equations.used + equations.left_out, 1)


def _ending(equations: NormalEquations, observed: NDArray[np.bool_], chart: NDArray[np.int32], told: str) -> str:
    seen = (observed & (chart >= 0)).sum() / max((chart >= 0).sum(), 1)
    text = f"{equations.used} pixels used; {seen:.0%} of the charts' texels observed; {told}"
    if _too_fine(equations):
        share = equations.left_out / (equations.used + equations.left_out)
        text += f"; {share:.0%} of the pixels span too many texels and were left out: make the texture smaller or the images larger"
    return text
