"""The process in which COLMAP runs: reads request.json and NAME.png of a folder, writes answer.json {name: K, R, t, distortion,
residual_px}.

python -m tasks.capture.structure_from_motion_worker FOLDER
"""

import json
import sys
from pathlib import Path

import cv2  # noqa: F401  before pycolmap, whose libpng otherwise takes OpenCV's place and crashes
import numpy as np
import pycolmap

SEED = 0


def main(folder: Path) -> None:
    """One run over the folder; the largest reconstruction is the answer."""
    request = json.loads((folder / "request.json").read_text())
    database = folder / "database.db"
    pycolmap.set_random_seed(SEED)
    _extract(folder, database, request)
    pycolmap.match_exhaustive(database, matching_options={"num_threads": request["threads"], "use_gpu": False})
    options = pycolmap.IncrementalPipelineOptions(num_threads=request["threads"], random_seed=SEED, min_model_size=3)
    if request["lenses"]:
        options.ba_refine_focal_length = options.ba_refine_extra_params = False
    found = pycolmap.incremental_mapping(database, folder, folder, options)
    best = max(found.values(), key=lambda r: r.num_reg_images(), default=None)
    (folder / "answer.json").write_text(json.dumps(_answer(best) if best else {}))


def _extract(folder: Path, database: Path, request: dict) -> None:
    for picture in sorted(folder.glob("*.png")):
        reader = pycolmap.ImageReaderOptions(camera_model="SIMPLE_RADIAL")
        if request["lenses"]:
            parameters = ",".join(map(repr, request["lenses"][picture.stem]))
            reader = pycolmap.ImageReaderOptions(camera_model="OPENCV", camera_params=parameters)
        options = pycolmap.FeatureExtractionOptions(num_threads=request["threads"], use_gpu=False)
        pycolmap.extract_features(
            database,
            folder,
            image_names=[picture.name],
            camera_mode=pycolmap.CameraMode.PER_IMAGE,
            reader_options=reader,
            extraction_options=options,
        )


def _answer(reconstruction: pycolmap.Reconstruction) -> dict:
    answer = {}
    for image in reconstruction.images.values():
        if not image.has_pose:
            continue
        camera, pose = image.camera, image.cam_from_world().matrix()
        points = [(p.xy, reconstruction.points3D[p.point3D_id].xyz) for p in image.get_observation_points2D()]
        errors = [np.linalg.norm(image.project_point(x) - uv) for uv, x in points]
        answer[Path(image.name).stem] = {
            "K": camera.calibration_matrix().tolist(),
            "R": pose[:, :3].tolist(),
            "t": pose[:, 3].tolist(),
            "distortion": [*camera.params[4:8], 0.0] if camera.model_name == "OPENCV" else [float(camera.params[3]), 0.0, 0.0, 0.0, 0.0],
            "residual_px": float(np.sqrt(np.mean(np.square(errors)))),
            "observations": len(errors),
        }
    return answer


if __name__ == "__main__":
    main(Path(sys.argv[1]))
