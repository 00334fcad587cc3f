"""The demo from images to report as a user runs it: small and whole in the default run, at its own size and under kills in the long one."""

import json
import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

SMALL = (
    "demo.cameras=4",
    "demo.frames=8",
    "demo.size=224",
    "demo.spp=4",
    "cloth.iterations=1",
    "appearance.texture_size=128",
    "cloth.frames=7",
)
KILLS = int(os.environ.get("KILLS", "4"))


def command(place: Path, *more: str) -> tuple[list[str], dict[str, str]]:
    environment = {**os.environ, "PHYSAVATAR_DATA": str(place / "data"), "PHYSAVATAR_STORE": str(place / "store"), "OMP_NUM_THREADS": "1"}
    return [sys.executable, "-m", "flows", *more], environment


def run(place: Path, *more: str) -> dict:
    arguments, environment = command(place, *more, "--json")
    ended = subprocess.run(arguments, env=environment, capture_output=True, text=True, check=False)
    assert ended.returncode == 0, ended.stderr
    return json.loads(ended.stdout)


def demo(*settings: str) -> list[str]:
    return ["demo", *(word for setting in settings for word in ("--set", setting))]


@pytest.fixture(scope="module")
def small(tmp_path_factory):
    place = tmp_path_factory.mktemp("small")
    return place, run(place, *demo(*SMALL))


def test_every_stage_runs_and_the_report_stands_alone(small):
    _, ended = small
    assert ended["state"] == "completed"
    assert set(ended["scores"]) >= {"mean joint error", "skirt: tracked vertices, rms error"}
    page = Path(ended["report"]).read_text()
    assert "Against the truth" in page
    assert "Not testable" in page  # eight frames are too few windows
    assert "Which effect is missing" in page
    assert 'href="gap.html"' in page and 'href="gap.json"' in page
    assert "<script" not in page
    assert 'src="http' not in page


def test_what_the_verdict_rests_on_lies_beside_the_page(small):
    _, ended = small
    beside = Path(ended["report"]).parent
    numbers = json.loads((beside / "gap.json").read_text())
    assert numbers["verdict"]["kind"] == "not_testable" and "evidence" in numbers
    assert numbers["verdict"]["sentence"] in (beside / "gap.html").read_text()


def test_a_second_submit_computes_nothing(small):
    place, first = small
    start = time.monotonic()
    again = run(place, *demo(*SMALL))
    assert {entry["state"] for entry in again["stages"].values()} == {"cached"}
    assert again["artifacts"] == first["artifacts"]
    assert time.monotonic() - start < 120  # generous: the target of 25 s is measured on an idle machine, see the README


def test_the_store_is_clean_and_the_plan_explains(small):
    place, _ = small
    assert run(place, "artifacts", "verify") == []
    arguments = [*demo(*SMALL, "cloth.density=400.0")[1:], "--explain"]
    planned = {row["stage"]: row for row in run(place, "plan", "demo", *arguments)}
    assert planned["tracking"]["cached"]
    assert not planned["cloth"]["cached"]
    assert "parameters.density: 320" in planned["cloth"]["why"]
    assert "will be made anew" in planned["report"]["why"]


def test_rerun_computes_again_from_a_stage_on(small):
    place, first = small
    again = run(place, "rerun", "demo", "--from", "gap", *demo(*SMALL)[1:])
    assert {name for name, entry in again["stages"].items() if entry["state"] == "completed"} == {"gap", "report"}
    assert again["artifacts"]["gap"] == first["artifacts"]["gap"]  # the same inputs give the same bytes


def test_the_avatar_leaves_as_files(small, tmp_path):
    place, _ = small
    written = run(place, "export", "demo", str(tmp_path), "--format", "glb", "--format", "npz", "--format", "mp4", "--format", "ply")
    assert {Path(p).suffix for p in written} == {".glb", ".npz", ".mp4", ".ply"}
    assert all(Path(p).stat().st_size > 1000 for p in written)
    tracked = np.load(tmp_path / "tracked.npz")
    assert tracked["vertices"].shape[0] == 8


@pytest.mark.slow
def test_kills_at_random_moments_change_nothing(small, tmp_path):
    _, whole = small
    seconds = random.Random(1)
    arguments, environment = command(tmp_path, *demo(*SMALL), "--json")
    for _ in range(KILLS):
        child = subprocess.Popen(arguments, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True)
        try:
            child.wait(timeout=seconds.uniform(5, 60))
        except subprocess.TimeoutExpired:
            os.killpg(child.pid, signal.SIGKILL)
            child.wait()
    ended = run(tmp_path, *demo(*SMALL))
    assert run(tmp_path, "artifacts", "verify") == []
    of = [{n: (a["key"], a["digest"]) for n, a in run["artifacts"].items() if n != "report"} for run in (ended, whole)]  # it tells the time
    assert of[0] == of[1]


@pytest.mark.slow
def test_the_demo_of_full_size_against_its_truth(tmp_path):
    """Margins a third to a half above the errors of 2026-11-21 (joints 21 mm, skirt 4.8, top 2.2 mm, κ_s/ρ 0.92 and 0.65, 28.1 dB)."""
    ended = run(tmp_path, *demo())
    scores = {name: score["value"] for name, score in ended["scores"].items()}
    assert scores["mean joint error before registration"] < 30
    assert scores["mean joint error"] < 12
    assert scores["skirt: tracked vertices, rms error"] < 7
    assert scores["top: tracked vertices, rms error"] < 4
    assert scores["image likeness, mean PSNR"] > 26
    for garment in ("skirt", "top"):
        assert 0.5 < scores[f"{garment}: kappa_s_over_rho, estimate/truth"] < 2
        bending = scores[f"{garment}: kappa_b_over_rho, estimate/truth"]
        assert bending is None or 1 / 3 < bending < 3  # None: the mesh is too coarse to tell
    page = Path(ended["report"]).read_text()
    assert all(name in page for name in scores)
    again = run(tmp_path, *demo())
    assert {entry["state"] for entry in again["stages"].values()} == {"cached"}
    assert again["scores"] == ended["scores"]
