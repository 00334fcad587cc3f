"""BVH files: positions in closed form, sampling by time, bone directions after retargeting, and three real recordings."""

import os
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

from tasks.body.skeleton import PARENTS
from tasks.capture.bvh import CMU_JOINTS, joint_positions, read_bvh, resample, retarget
from tasks.geometry.faults import BadInput
from tasks.geometry.rotations import matrix_from_axis_angle

ARM = """HIERARCHY\r
ROOT Shoulder\r
{{
OFFSET 1 2 3
CHANNELS 6 Xposition Yposition Zposition Zrotation Yrotation Xrotation\r
 JOINT Elbow
 {{
 OFFSET 0 -4 0
 CHANNELS 3 {order}
  End Site
  {{
  OFFSET 0 -3 0
  }}
 }}
}}
MOTION\r
Frames: {frames}
Frame Time: 0.1\r
{values}
"""


def arm(tmp_path: Path, rows: list[list[float]], order: str = "Zrotation Xrotation Yrotation") -> Path:
    path = tmp_path / "arm.bvh"
    values = "\n".join(" ".join(map(str, row)) for row in rows)
    path.write_bytes(ARM.format(frames=len(rows), values=values, order=order).encode())
    return path


def tip(bvh) -> np.ndarray:
    x, G = joint_positions(bvh)
    return x[:, 1] + G[:, 1] @ bvh.tips[1]


def test_positions_in_closed_form(tmp_path) -> None:
    """Upper arm raised to the side by 90 degrees, forearm bent forwards by 90 degrees about its own x axis."""
    bvh = read_bvh(arm(tmp_path, [[10, 20, 30, 90, 0, 0, 0, 90, 0]]), unit=0.5)
    x, _ = joint_positions(bvh)
    assert bvh.fps == pytest.approx(10)
    assert_allclose(x[0, 0], [5.5, 11, 16.5])
    assert_allclose(x[0, 1], x[0, 0] + [2, 0, 0], atol=1e-12)
    assert_allclose(tip(bvh)[0], x[0, 1] + [0, 0, -1.5], atol=1e-12)


def test_order_of_channels_is_that_of_each_joint(tmp_path) -> None:
    row = [[0, 0, 0, 0, 0, 0, 90, 90, 0]]
    zxy, xzy = (tip(read_bvh(arm(tmp_path, row, order))) for order in ("Zrotation Xrotation Yrotation", "Xrotation Zrotation Yrotation"))
    assert np.linalg.norm(zxy - xzy) > 0.1


def test_resampling_goes_by_time_and_across_wraps(tmp_path) -> None:
    """A turn at constant speed whose angle jumps from 170 to -170 degrees."""
    angles = (100 + 35 * np.arange(6) + 180) % 360 - 180
    bvh = read_bvh(arm(tmp_path, [[t, 0, 0, 0, 0, 0, a, 0, 0] for t, a in enumerate(angles)]), unit=1.0)
    fine = resample(bvh, 40.0)
    assert len(fine) == 21 and fine.fps == 40
    want = matrix_from_axis_angle(np.radians(100 + 35 * np.arange(21) / 4)[:, None] * [0, 0, 1])
    assert_allclose(fine.rotations[:, 1], want, atol=1e-12)
    assert_allclose(fine.translation[:, 0], np.arange(21) / 4, atol=1e-12)


def test_a_single_frame_is_itself_at_any_rate(tmp_path) -> None:
    bvh = read_bvh(arm(tmp_path, [[10, 20, 30, 90, 0, 0, 0, 90, 0]]))
    fine = resample(bvh, 40.0)
    assert len(fine) == 1 and fine.fps == 40
    assert_allclose(tip(fine), tip(bvh))


def test_an_absent_file_and_a_time_that_runs_backwards_are_refused(tmp_path) -> None:
    with pytest.raises(BadInput, match=r"absent\.bvh: it cannot be read"):
        read_bvh(tmp_path / "absent.bvh")
    path = arm(tmp_path, [[0] * 9])
    path.write_text(path.read_text().replace("Frame Time: ", "Frame Time: -"))
    with pytest.raises(BadInput, match="a frame time of -0"):
        read_bvh(path)


def test_a_file_cut_short_is_refused(tmp_path) -> None:
    path = arm(tmp_path, [[0] * 9, [0] * 9])
    path.write_text(path.read_text()[:-4])
    with pytest.raises(BadInput, match="cut short"):
        read_bvh(path)
    path.write_text("ply\n")
    with pytest.raises(BadInput, match="HIERARCHY"):
        read_bvh(path)


def test_damaged_files_are_refused_or_read_never_a_crash(tmp_path, damage) -> None:
    rng = np.random.default_rng(0)
    refused = 0
    for _ in range(60):
        path = arm(tmp_path, [[1.5, 0, 0, 90, 0, 0, 0, 45, 0]] * 3)
        damage(path, rng)
        try:
            assert np.isfinite(joint_positions(read_bvh(path))[0]).all()
        except BadInput:
            refused += 1
    assert 20 < refused < 60


def real_motions() -> list[Path]:
    folder = Path(os.environ.get("PHYSAVATAR_REAL_DATA", Path(__file__).parents[2] / "../shared/data")) / "motion"
    return sorted(folder.glob("*.bvh"))


@pytest.fixture(scope="module")
def motions() -> dict:
    files = real_motions()
    if not files:
        pytest.skip("real motions are absent: set PHYSAVATAR_REAL_DATA")
    return {path.stem: read_bvh(path) for path in files}


@pytest.mark.parametrize(("name", "frames", "low", "high", "speed"), [
    ("131_01", 994, 0.50, 0.97, 2.0), ("131_02", 1247, 0.93, 1.01, 0.7), ("131_03", 1102, 0.80, 1.11, 2.3)
])  # fmt: skip
def test_real_hips_are_at_human_heights(motions, name, frames, low, high, speed) -> None:
    bvh = motions[name]
    hips = joint_positions(bvh)[0][:, 0]
    assert len(bvh) == frames and bvh.fps == pytest.approx(120, abs=0.01)
    assert_allclose([hips[:, 1].min(), hips[:, 1].max()], [low, high], atol=0.006)
    assert np.linalg.norm(np.diff(hips, axis=0), axis=1).max() * bvh.fps == pytest.approx(speed, abs=0.06)


def test_retargeted_bones_point_as_in_the_file(motions) -> None:
    """On a body of other proportions in T-pose, every limb points where the file's limb points, and a wrong table does not do that."""
    bvh = resample(motions["131_02"], 25.0)
    joints = t_pose()
    motion = retarget(bvh, joints, PARENTS)
    x, _ = joint_positions(bvh)
    posed = forward(joints, motion)
    for j, (name, child, model_child) in CMU_JOINTS.items():
        if child is None or model_child in (28, 43):
            continue
        want = x[:, bvh.names.index(child)] - x[:, bvh.names.index(name)]
        have = posed[:, model_child] - posed[:, j]
        cosine = np.sum(want * have, 1) / np.linalg.norm(want, axis=1) / np.linalg.norm(have, axis=1)
        assert cosine.min() > 1 - 1e-9, (j, name)
    assert 0.8 < posed[:, 0, 1].mean() / x[:, 0, 1].mean() < 1.25
    assert posed[:, [7, 8], 1].min() > -0.05


def test_a_table_that_does_not_fit_the_file_is_refused(tmp_path) -> None:
    with pytest.raises(BadInput, match="LeftKnee"):
        retarget(read_bvh(arm(tmp_path, [[0] * 9])), t_pose(), PARENTS)


def t_pose() -> np.ndarray:
    """Rest joints of a person with arms spread, in SMPL-X order; fingers in the wrist."""
    x = np.zeros((55, 3))
    for side, s in ((0, 1.0), (1, -1.0)):
        x[[1 + side, 4 + side, 7 + side, 10 + side]] = [
            [s * 0.1, -0.05, 0],
            [s * 0.11, -0.45, 0.02],
            [s * 0.12, -0.9, 0],
            [s * 0.13, -0.95, 0.15],
        ]
        x[[13 + side, 16 + side, 18 + side, 20 + side]] = [
            [s * 0.05, 0.4, 0],
            [s * 0.17, 0.42, 0],
            [s * 0.43, 0.42, 0],
            [s * 0.68, 0.42, 0],
        ]
        x[25 + 15 * side : 40 + 15 * side] = [s * 0.78, 0.42, 0]
    x[[3, 6, 9, 12, 15, 22, 23, 24]] = [
        [0, 0.1, 0],
        [0, 0.23, 0],
        [0, 0.3, 0],
        [0, 0.5, 0],
        [0, 0.6, 0.02],
        [0, 0.6, 0.04],
        [0.03, 0.66, 0.1],
        [-0.03, 0.66, 0.1],
    ]
    return x


def forward(joints: np.ndarray, motion) -> np.ndarray:
    """Posed joints [time, 55, 3] by the plain recursion over the tree."""
    R = matrix_from_axis_angle(motion.pose)
    G, x = np.empty_like(R), np.empty((len(motion), 55, 3))
    for j, parent in enumerate(PARENTS):
        G[:, j] = R[:, j] if parent < 0 else G[:, parent] @ R[:, j]
        x[:, j] = joints[j] + motion.translation if parent < 0 else x[:, parent] + G[:, parent] @ (joints[j] - joints[parent])
    return x
