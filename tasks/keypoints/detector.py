"""133 keypoints of a person in each view of a recording, by an ONNX network with SimCC outputs: the bundled one, or DWPose, RTMW, RTMPose.

    crop = warp(image, box);     (s_x, s_y) = ½ [net(crop) + unflip(net(mirror(crop)))];     u = decode(s_x, s_y), back in the picture

Source: Jiang et al., "RTMPose" (2023); Yang et al., "DWPose" (2023). All these files take RGB normalised by ImageNet's mean and deviation
and give two outputs [batch, keypoint, split · side]; sizes and split are read from the file.
Limits: the bundled model has seen rendered people only (figures in the README of this folder); scores of different models are not
comparable.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import onnxruntime
from onnxruntime.capi import onnxruntime_pybind11_state as ort

from tasks.body.wholebody import FLIP
from tasks.geometry.faults import BadInput, Fault, refuse
from tasks.keypoints.crop import crop_matrix, map_back, normalised, warp
from tasks.keypoints.person_box import box_from_keypoints, box_from_mask
from tasks.keypoints.simcc import decode, unflip

# onnxruntime raises a class of its own for each kind of broken file; they share no parent but Exception
ORT_ERRORS = (ort.Fail, ort.InvalidArgument, ort.InvalidGraph, ort.InvalidProtobuf, ort.NotImplemented, ort.RuntimeException)
BUNDLED = Path(__file__).with_name("synthetic_people_v1.onnx")
KEYPOINTS = 133
REMEDY = (
    "Point keypoints.model at a whole-body SimCC model of 133 keypoints (DWPose dw-ll_ucoco_384.onnx, RTMW or RTMPose whole-body), "
    "or leave the setting out for the bundled model."
)


@dataclass(frozen=True)
class Detections:
    """uv [camera,133,2] px of the original pictures (centre of the first pixel = 0.5), score [camera,133]; NaN and 0 without a person.
    box [camera,4] px that was looked at in the end."""

    uv: np.ndarray
    score: np.ndarray
    box: np.ndarray


@dataclass(frozen=True)
class Detector:
    """A loaded network: `size` (width, height) of its input, `split` bins per pixel, `trained_on` as the file says, or empty."""

    session: onnxruntime.InferenceSession
    size: tuple[int, int]
    split: float
    trained_on: str

    @staticmethod
    def load(path: Path | str = BUNDLED, *, threads: int = 1) -> Detector:
        """Open a model file. Raises BadInput that names the file, what was found in it, and the remedy."""
        path = Path(path)
        if not path.is_file():
            refuse([Fault(str(path), "no such file", REMEDY)])
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = threads
        options.log_severity_level = 4
        try:
            session = onnxruntime.InferenceSession(str(path), options, providers=["CPUExecutionProvider"])
        except ORT_ERRORS as error:
            raise BadInput([Fault(str(path), f"not a readable ONNX model ({str(error).splitlines()[0][:160]})", REMEDY)]) from error
        size, split = _layout(session, str(path))
        return Detector(session, size, split, session.get_modelmeta().custom_metadata_map.get("trained_on", ""))

    def detect(
        self,
        images: list[np.ndarray],
        *,
        masks: list[np.ndarray] | None = None,
        boxes: np.ndarray | None = None,
        refine: int = 0,
    ) -> Detections:
        """Keypoints of the person in every picture [height,width,3] RGB uint8, one per camera.

        The person's place comes from `masks` ([height,width] each) or `boxes` [camera,4] (left, top, right, bottom px); a NaN box or an
        empty mask gives no keypoints. `refine` times the box is drawn anew around the keypoints found, which mends a box that is off.
        """
        if boxes is None:
            if masks is None:
                raise ValueError("detect() needs masks or boxes")
            boxes = np.stack([box_from_mask(mask) for mask in masks])
        for _ in range(refine):
            found = self._once(images, boxes)
            boxes = np.stack([box_from_keypoints(uv, score, fallback=box) for uv, score, box in zip(found.uv, found.score, boxes)])
        return self._once(images, boxes)

    def _once(self, images: list[np.ndarray], boxes: np.ndarray) -> Detections:
        uv, score = np.full((len(images), KEYPOINTS, 2), np.nan), np.zeros((len(images), KEYPOINTS))
        for camera, (image, box) in enumerate(zip(images, boxes, strict=True)):
            if np.isfinite(box).all():
                matrix = crop_matrix(box, self.size)
                found, score[camera] = self.read_crop(warp(image, matrix, self.size))
                uv[camera] = map_back(found, matrix)
        return Detections(uv, score, boxes)

    def read_crop(self, crop: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Keypoints [133,2] px of the crop and scores [133], the mean of the crop [height,width,3] and its mirror image."""
        both = normalised(np.stack([crop, cv2.flip(crop, 1)]))
        simcc_x, simcc_y = self.session.run(None, {self.session.get_inputs()[0].name: both})
        mirrored_x, mirrored_y = unflip(simcc_x[1], simcc_y[1], FLIP, split=self.split)
        return decode((simcc_x[0] + mirrored_x) / 2, (simcc_y[0] + mirrored_y) / 2, split=self.split)


def _layout(session: onnxruntime.InferenceSession, path: str) -> tuple[tuple[int, int], float]:
    """Input size and split of a SimCC whole-body model, by a trial run on grey (shapes in the file may be symbolic). Raises BadInput."""
    inputs, outputs = session.get_inputs(), session.get_outputs()
    if len(inputs) != 1 or len(inputs[0].shape) != 4 or inputs[0].type != "tensor(float)":
        found = ", ".join(f"{i.name} {i.shape} {i.type}" for i in inputs)
        refuse([Fault(path, f"inputs are {found}; expected one float image batch [batch,3,height,width]", REMEDY)])
    height, width = inputs[0].shape[2:]
    if not (isinstance(height, int) and isinstance(width, int)):
        refuse([Fault(path, f"its input size is open: {inputs[0].shape}", "Export it with fixed height and width. " + REMEDY)])
    if len(outputs) != 2:
        named = ", ".join(f"{o.name} {o.shape}" for o in outputs)
        refuse([Fault(path, f"{len(outputs)} outputs ({named}); a SimCC model has two. A person detector or heat-map model?", REMEDY)])
    if isinstance(inputs[0].shape[0], int) and inputs[0].shape[0] != 2:
        refuse([Fault(path, f"its batch is fixed at {inputs[0].shape[0]}", "Export it with a dynamic batch axis. " + REMEDY)])
    try:
        x, y = session.run(None, {inputs[0].name: np.zeros((2, 3, height, width), np.float32)})
    except ORT_ERRORS as error:
        raise BadInput([Fault(path, f"a trial run failed ({str(error).splitlines()[0][:160]})", REMEDY)]) from error
    if x.ndim != 3 or y.ndim != 3 or x.shape[:2] != (2, KEYPOINTS) or y.shape[:2] != (2, KEYPOINTS):
        refuse([Fault(path, f"outputs are {x.shape} and {y.shape}; expected [batch, {KEYPOINTS}, bins] twice", REMEDY)])
    if x.shape[2] * height != y.shape[2] * width or x.shape[2] < width:
        refuse([Fault(path, f"{x.shape[2]} and {y.shape[2]} bins do not fit an input of {width} x {height} px", REMEDY)])
    return (width, height), x.shape[2] / width
