"""The network as an ONNX file: SimCC outputs, dynamic batch, weights stored in half precision.

Halving the weights' storage changes an output by less than the float16 rounding of a weight; the arithmetic stays float32, because a Cast
follows each stored weight (onnxruntime folds it when the file is loaded).
"""

from __future__ import annotations

import copy
from pathlib import Path

import torch

from tasks.keypoints.crop import INPUT_SIZE
from tasks.keypoints.network import SimccNet, WholeBodyNet

OPSET = 17
STORED_HALF = 1024  # initialisers with at least this many numbers are stored in float16


def write_onnx(net: WholeBodyNet, path: Path, *, size: tuple[int, int] = INPUT_SIZE) -> None:
    """Write `net` to `path` for crops of `size` (width, height), in evaluation mode whatever mode it is in now.

    Input `input`, outputs `simcc_x`, `simcc_y`, batch size open.
    """
    model = SimccNet(copy.deepcopy(net), size).eval().to(memory_format=torch.contiguous_format)
    aside = path.with_suffix(".tmp.onnx")
    torch.onnx.export(
        model,
        (torch.zeros(1, 3, size[1], size[0]),),
        str(aside),
        input_names=["input"],
        output_names=["simcc_x", "simcc_y"],
        dynamic_axes={name: {0: "batch"} for name in ("input", "simcc_x", "simcc_y")},
        opset_version=OPSET,
        dynamo=False,
    )
    _store_half(aside)
    aside.replace(path)


def _store_half(path: Path) -> None:
    import onnx
    from onnx import helper, numpy_helper

    model = onnx.load(path)
    casts = []
    for tensor in model.graph.initializer:
        array = numpy_helper.to_array(tensor)
        if array.dtype == "float32" and array.size >= STORED_HALF:
            name = tensor.name
            tensor.CopyFrom(numpy_helper.from_array(array.astype("float16"), f"{name}.half"))
            casts.append(helper.make_node("Cast", [f"{name}.half"], [name], to=onnx.TensorProto.FLOAT))
    nodes = [*casts, *model.graph.node]
    del model.graph.node[:]
    model.graph.node.extend(nodes)
    entry = model.metadata_props.add()
    entry.key, entry.value = "trained_on", "synthetic people: rendered bodies of the project's demo body, no photographs"
    onnx.checker.check_model(model)
    onnx.save(model, path)
