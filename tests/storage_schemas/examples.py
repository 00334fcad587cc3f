"""One small record of every schema, seeded, with every optional field given. Used by the tests and to write archives."""

from __future__ import annotations

import numpy as np

from storage_schemas.appearance import Appearance
from storage_schemas.body import Body
from storage_schemas.capture import Capture
from storage_schemas.cloth import Cloth
from storage_schemas.gap import Gap
from storage_schemas.key import artifact_key
from storage_schemas.keypoints import Keypoints
from storage_schemas.provenance import Provenance
from storage_schemas.record import Record
from storage_schemas.registration import Registration
from storage_schemas.report import Report
from storage_schemas.skinning import Skinning
from storage_schemas.tracking import Tracking

T, C, V, F = 3, 2, 4, 2  # frames, cameras, vertices, faces
TETRAHEDRON = np.array([[0, 1, 2], [0, 2, 3]], np.int32)
SHA = "0123456789abcdef" * 4


def key_of(number: int, stage: str = "keypoints") -> str:
    """A key that differs with `number`."""
    return artifact_key(stage=stage, stage_version=1, schema_version=1, parameters={"number": number}, inputs={}, weights={})


def provenance(**inputs) -> Provenance:
    """Where an example comes from."""
    return Provenance(stage="example", stage_version=1, inputs=inputs, parameters={"step": 0.01})


def keypoints(*, frames: int = T, seed: int = 0) -> Keypoints:
    """Detections in two cameras; noise, so that chunks do not compress away."""
    random = np.random.default_rng(seed)
    return Keypoints(
        keypoints=random.uniform(0, 512, (frames, C, 133, 2)).astype("float32"),
        score=random.uniform(0, 1, (frames, C, 133)).astype("float32"),
        boxes=random.uniform(0, 512, (frames, C, 4)).astype("float32"),
        camera_names=("left", "right"),
        detector="example",
        detector_sha256=SHA,
    )


def examples() -> dict[str, Record]:
    """Schema name -> record."""
    random = np.random.default_rng(7)
    weights = random.dirichlet(np.ones(55), V).astype("float32")
    surface = random.normal(size=(T, V, 3)).astype("float32")
    records = [
        Capture(
            K=np.tile(np.diag([500.0, 500.0, 1.0]), (C, 1, 1)),
            R=np.tile(np.eye(3), (C, 1, 1)),
            t=np.zeros((C, 3)),
            distortion=np.zeros((C, 5)),
            size=np.full((C, 2), 512, "int32"),
            frame_numbers=np.array([10, 11, 13], "int32"),
            camera_names=("left", "right"),
            fps=25.0,
            up="y",
            rgb=("left/{frame:04d}.png", "right.mp4"),
            sha256=dict.fromkeys(("left/0010.png", "left/0011.png", "left/0013.png", "right.mp4", "template/template.obj"), SHA),
            template="template/template.obj",
            mass_kg=0.4,
            warnings=("frame 12 is missing",),
        ),
        keypoints(),
        Body(
            pose=random.normal(size=(T, 55, 3)).astype("float32"),
            shape=np.zeros(10, "float32"),
            expression=np.zeros((T, 10), "float32"),
            translation=np.zeros((T, 3), "float32"),
            vertices=surface,
            joints=np.zeros((T, 55, 3), "float32"),
            transforms=np.tile(np.eye(4, dtype="float32"), (T, 55, 1, 1)),
            faces=TETRAHEDRON,
            weights=weights,
            reprojection_px=np.full((T, C, 133), np.nan, "float32"),
            scale=1.0,
            model="example",
            model_sha256=SHA,
            ending="converged after 12 steps",
        ),
        Tracking(
            vertices=surface,
            faces=TETRAHEDRON,
            uv_vertices=random.uniform(size=(5, 2)).astype("float32"),
            uv_faces=np.array([[0, 1, 2], [3, 4, 0]], "int32"),
            part_names=("body", "skirt"),
            part_of_face=np.array([0, 1], "int32"),
            seen=random.uniform(size=(T, V)) < 0.5,
            noise_m=np.full((T, V), 1e-3, "float32"),
            photometric_rms=np.full(T, 0.02, "float32"),
            endings=("converged",),
        ),
        Skinning(weights=weights, matched=np.ones(V, bool), rest_vertices=surface[0], unmatched_pieces=[{"part": "skirt", "vertices": 3}]),
        Cloth(
            garment_names=("skirt",),
            vertices_index=np.array([0, 1, 2], "int32"),
            garment_of_vertex=np.zeros(3, "int32"),
            simulated=surface[:, :3],
            faces=TETRAHEDRON[:1],
            boundary=np.array([True, False, False]),
            parameters={"skirt": {"kappa_s_over_rho": {"value": 2.0, "low": 1.0, "high": 4.0, "unit": "m3/kg"}}},
            loss_history=[3.0, 2.0],
            timing={"simulate": 1.5},
            endings=("converged",),
            knowledge={"skirt": {"gauge": {"sentence": "only ratios"}}},
        ),
        Appearance(
            albedo=random.uniform(size=(6, 5, 3)).astype("float32"),
            observed=np.ones((6, 5), bool),
            light=np.ones(3, "float32"),
            psnr=np.array([[30.0, np.nan]], "float32"),
            gains=np.ones((C, 3), "float32"),
            training_frames=(10, 11),
        ),
        Gap(
            residual=surface * 0.01,
            residual_mm=np.linalg.norm(surface * 0.01, axis=-1).astype("float32") * 1e3,
            zone_names=("free", "hem"),
            zone_of_vertex=np.array([0, 0, 1, 1], "int32"),
            tables={"hem": {"normal": 3.0}},
            floor_mm=1.0,
            verdict={"version": 1, "verdict": {"kind": "none"}},
            files={"gap.html": b"<p>none</p>", "gap.json": b"{}"},
        ),
        Report(files={"report.html": b"<p>gap 3 mm</p>", "plot.png": b"\x89PNG"}, summary={"before_mm": 3}),
    ]
    fitted = next(record for record in records if type(record) is Body)
    records.append(Registration(**{name: getattr(fitted, name) for name in Body.model_fields}, distance_m=np.full((T, 2), 1e-3, "float32")))
    return {record.schema_name: record for record in records}
