"""The door of body: which model it fits, and by what that is known."""

from types import SimpleNamespace

import numpy as np
import pytest

from storage_schemas.keypoints import Keypoints
from tasks.body import anny_body
from tasks.body.anny_body import demo_body_digest
from tasks.body.model import BodyModel
from tasks.body.shape_space import COMPONENTS, _principal
from tasks.body.stage import BodyParameters, body
from tasks.registration.stage import RegistrationParameters, registration
from tests.body.actors import actor, detections, ring
from tests.storage_schemas.examples import examples

DOORS = pytest.mark.parametrize(("door", "parameters"), [(body, BodyParameters), (registration, RegistrationParameters)])


def captured(cameras, frames: int):
    """A capture artifact of these cameras."""
    rig = {"K": cameras.K, "R": cameras.R, "t": cameras.t, "distortion": cameras.distortion, "size": cameras.size.astype("int32")}
    told = {"camera_names": cameras.names, "frame_numbers": np.arange(frames, dtype="int32")}
    return examples()["capture"].model_copy(update=rig | told)


def seen(cameras, uv: np.ndarray, score: np.ndarray) -> Keypoints:
    boxes = np.zeros((*uv.shape[:2], 4), np.float32)
    names = {"camera_names": cameras.names, "detector": "truth", "detector_sha256": "0" * 64}
    return Keypoints(keypoints=uv.astype(np.float32), score=score.astype(np.float32), boxes=boxes, **names)


def job(warnings: list[str]) -> SimpleNamespace:
    return SimpleNamespace(progress=lambda fraction, text: None, warn=warnings.append)


@DOORS
def test_the_demo_body_enters_the_key_by_its_recipe_and_a_file_by_its_content(door, parameters, tmp_path, monkeypatch):
    given = tmp_path / "model.npz"
    given.write_bytes(b"a model")
    was = [door.key({}, p) for p in (parameters(), parameters(model=given))]
    monkeypatch.setattr(anny_body, "anny_version", lambda: "99")
    now = [door.key({}, p) for p in (parameters(), parameters(model=given))]
    assert now[0] != was[0] and now[1] == was[1]


def test_the_fitted_demo_body_is_known_by_its_recipe(model):
    cameras, known = ring(4), actor(model, 1, seed=0)
    keypoints = seen(cameras, *detections(model, cameras, known.posed, seed=1))
    found = body.function(job([]), captured(cameras, 1), keypoints, BodyParameters())
    assert found.model_sha256 == demo_body_digest()
    assert found.model.startswith("smplx_demo_anny")


def test_frames_that_did_not_settle_are_warned_of(model):
    cameras, known, warnings = ring(4), actor(model, 3, seed=0), []
    uv, score = detections(model, cameras, known.posed, seed=1)
    uv[0], score[0] = np.nan, 0
    found = body.function(job(warnings), captured(cameras, 3), seen(cameras, uv, score), BodyParameters())
    assert warnings == ["the body did not settle in 1 of 3 frames, the first is 0"]
    np.testing.assert_allclose(found.vertices[0], found.vertices[1], atol=1e-6)


def test_registration_takes_the_demo_body_of_another_processor(monkeypatch, tmp_path):
    """Its file has other last bits there, so other bytes."""
    elsewhere = tmp_path / "smplx_demo.npz"
    elsewhere.write_bytes(b"other bytes")
    monkeypatch.setattr("tasks.registration.stage.demo_body", lambda: elsewhere)
    monkeypatch.setattr(BodyModel, "load", lambda path: pytest.fail(f"loaded {path.name}"))
    known = examples()
    fitted = known["body"].model_copy(update={"model_sha256": demo_body_digest()})
    with pytest.raises(pytest.fail.Exception, match=r"loaded smplx_demo\.npz"):
        registration.function(None, known["capture"], known["keypoints"], fitted, known["tracking"], RegistrationParameters())


@pytest.mark.parametrize("last_bits", [-1e-12, 1e-12])
def test_the_sign_of_a_component_does_not_hang_on_last_bits(last_bits):
    rng = np.random.default_rng(0)
    samples = np.zeros((2 * COMPONENTS, 9, 3))
    samples[:, 2:] = 0.01 * rng.normal(size=(2 * COMPONENTS, 7, 3))
    samples[:, :2, 0] = rng.normal(size=(2 * COMPONENTS, 1)) * [1, -(1 + last_bits)]  # two vertices, mirror images in x
    assert _principal(samples)[0, 0, 0] > 0
