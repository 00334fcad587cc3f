"""Pictures for the report: overlays on the recording and heat maps, drawn into arrays and kept as PNG or JPEG text."""

import base64
import io
from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from tasks.geometry.cameras import Cameras, project
from tasks.geometry.rasterise import rasterise

Image = NDArray[np.uint8]
MESH, POINT, LIMB = (80, 200, 255), (255, 210, 60), (90, 255, 140)


def data_uri(image: Image, *, quality: int = 82) -> str:
    """The picture as text that stands in a page of its own."""
    ok, jpeg = cv2.imencode(".jpg", np.ascontiguousarray(image[..., ::-1]), [cv2.IMWRITE_JPEG_QUALITY, quality])
    if not ok:
        raise ValueError(f"cannot encode an image of shape {image.shape}")
    return "data:image/jpeg;base64," + base64.b64encode(jpeg.tobytes()).decode()


def figure_uri(figure: object) -> str:
    """A matplotlib figure as SVG text; the same figure gives the same bytes."""
    import matplotlib

    buffer = io.BytesIO()
    with matplotlib.rc_context({"svg.hashsalt": "physavatar"}):  # else every id in it is drawn anew
        figure.savefig(buffer, format="svg", bbox_inches="tight", metadata={"Date": None})
    return "data:image/svg+xml;base64," + base64.b64encode(buffer.getvalue()).decode()


def draw_keypoints(
    image: Image, keypoints: NDArray, score: NDArray, limbs: Sequence[tuple[int, int]] | NDArray[np.integer], *, least: float = 0.3
) -> Image:
    """Points [point, 2] px with score [point] ≥ `least`, limbs between them."""
    out = image.copy()
    thick = max(1, round(min(image.shape[:2]) / 400))
    sure = (score >= least) & np.isfinite(keypoints).all(-1)
    for a, b in limbs:
        if sure[a] and sure[b]:
            cv2.line(out, _pixel(keypoints[a]), _pixel(keypoints[b]), LIMB, thick, cv2.LINE_AA)
    for point in keypoints[sure]:
        cv2.circle(out, _pixel(point), thick + 1, POINT, -1, cv2.LINE_AA)
    return out


def draw_mesh(
    image: Image, cameras: Cameras, camera: int, vertices: NDArray, faces: NDArray, *, colour: NDArray | tuple = MESH, opacity: float = 0.6
) -> Image:
    """Shade a mesh over the picture of one camera; colour is one RGB or one per face [F, 3]. Lens distortion is ignored."""
    seen = rasterise(cameras.K[camera], cameras.R[camera], cameras.t[camera], tuple(cameras.size[camera]), vertices, faces)
    inside = seen.face >= 0
    corners = vertices[faces]
    n = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    n /= np.maximum(np.linalg.norm(n, axis=1, keepdims=True), 1e-12)
    shade = 0.35 + 0.65 * np.abs(n @ cameras.R[camera][2])
    rgb = np.broadcast_to(np.asarray(colour, float), (len(faces), 3)) * shade[:, None]
    out = image.astype(float)
    out[inside] = (1 - opacity) * out[inside] + opacity * rgb[seen.face[inside]]
    return np.clip(out, 0, 255).astype(np.uint8)


def heat(values: NDArray, top: float) -> NDArray:
    """Colours [n, 3] in 0–255 for values from 0 to `top`; grey where NaN."""
    from matplotlib import colormaps

    rgb = 255 * colormaps["inferno"](np.clip(values / max(top, 1e-12), 0, 1))[:, :3]
    return np.where(np.isfinite(values)[:, None], rgb, 128.0)


def crop_to(image: Image, cameras: Cameras, camera: int, x: NDArray, *, margin: float = 0.15) -> Image:
    """The part of the picture that holds the points x [n, 3] m, with a margin."""
    uv = project(cameras.subset([camera]), x)[0][0]
    uv = uv[np.isfinite(uv).all(-1)]
    if not len(uv):
        return image
    low, high = uv.min(0), uv.max(0)
    pad = margin * max(high - low)
    height, width = image.shape[:2]
    x0, y0 = np.clip(low - pad, 0, [width - 1, height - 1]).astype(int)
    x1, y1 = np.clip(high + pad, [x0 + 1, y0 + 1], [width, height]).astype(int)
    return image[y0:y1, x0:x1]


def strip(images: Sequence[Image], *, height: int = 380) -> Image:
    """Pictures side by side at one height."""
    scaled = [cv2.resize(i, (max(1, round(i.shape[1] * height / i.shape[0])), height), interpolation=cv2.INTER_AREA) for i in images]
    return np.concatenate(scaled, 1)


def _pixel(point: NDArray) -> tuple[int, int]:
    return int(np.floor(point[0])), int(np.floor(point[1]))
