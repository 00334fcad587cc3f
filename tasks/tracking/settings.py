"""Every number of the tracker, with its unit and where it comes from."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Settings:
    """Defaults were chosen on the synthetic skirt of the tests (mean edge 24 mm, 2.7 mm/px); README.md has the measurements."""

    blur_px: tuple[float, ...] = (8.0, 4.0, 2.0, 1.0)
    """Standard deviation of the image blur, coarse to fine [px]."""
    steps: tuple[int, ...] = (5, 4, 4, 6)
    """Most Gauss–Newton steps at each blur."""
    look_again: int = 3
    """Steps taken between two looks at what is visible."""
    settled_px: float = 0.02
    """A blur level ends when the mean step falls below this share of its blur [px per px of blur]."""
    sigma_colour: float = 0.06
    """Residual of colours in [0, 1] that counts as one standard deviation (Cauchy)."""
    sigma_mask: float = 0.2
    """The same for the mask in [0, 1]: outlines of masks are ragged."""
    sigma_outline: float | None = 1.0
    """Distance of the surface's rim from the mask's outline of one standard deviation [px], at least the blur (Cauchy);
    None leaves the term out.
    """
    sigma_strain: float = 0.02
    """Edge strain of one standard deviation, on edges of 24 mm (isometry.py)."""
    sigma_normal: float = 0.3
    """Difference of neighbouring unit normals of one standard deviation."""
    sigma_prediction: float = 0.03
    """Distance from the predicted place of one standard deviation, for vertices that have a prediction [m]."""
    sigma_inertia: float = 0.02
    """Distance from where constant velocity leads of one standard deviation, for all other vertices [m]:
    it decides only where the images do not.
    """
    damping: float = 200.0
    """Smallest Levenberg–Marquardt damping, on the diagonal [1/m²]."""
    largest_step: float = 0.03
    """No vertex moves further in one step [m]."""
    subdivision: int = 2
    """Samples per face: the centroids of its subdivision² equal parts."""
    facing: float = 0.15
    """Smallest cosine between a face's normal and the line of sight."""
    facing_reference: float = 0.2
    """The same, where reference colours are taken."""
    depth_tolerance_edges: float = 0.25
    """A sample may lie this many mean edge lengths behind the z-buffer and still count as seen."""
    layer_tolerance: float = 0.02
    """Cloth may lie this far behind the skin of the template before skin hides it [m]: it is worn outside, so it is tracking error,
    which its noise then states (inside_skin.py).
    """
    occluder_tolerance: float = 0.04
    """Samples may lie this far behind the occluder before it hides them [m]: a fitted body is not the body."""
    buffer_scale: float = 0.5
    """Size of the z-buffers relative to the images."""
    camera_gain: bool = False
    """Estimate a gain and an offset per camera and colour in frame 0 and undo them in all frames."""
    noise_calibration: float = 1.0
    """Errors over what the posterior promises. At 1, 0.98 of the coordinates seen of a textured skirt lie within two standard deviations
    and 0.24 of a plain one's from four views (shares that tests/benchmarks/tracking.py prints; nothing is fitted to them).
    """
