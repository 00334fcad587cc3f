"""The body of `model.py` in torch, with gradients: for whatever is fitted by descent through the surface (tracking, appearance).

Skinning is `smplx.lbs.lbs` of the smplx package (Pavlakos et al. 2019); nothing is derived here. The keypoint fit does not use this: it has
exact derivatives of its own (`keypoint_body.py`).
Limits: CPU or one device; single precision by default.
"""

import numpy as np
import torch
from smplx.lbs import lbs

from tasks.body.model import JOINTS, BodyModel


class TorchBody(torch.nn.Module):
    """Holds a model's arrays as buffers; `forward` poses it."""

    def __init__(self, model: BodyModel, *, dtype: torch.dtype = torch.float32) -> None:
        super().__init__()
        directions = np.concatenate([model.shape_directions, model.expression_directions], axis=2)
        correctives = (
            np.zeros((len(model.template), 3, 9 * (JOINTS - 1)), np.float32) if model.pose_directions is None else model.pose_directions
        )
        arrays = {
            "template": model.template[None],
            "directions": directions,
            "correctives": correctives.reshape(-1, correctives.shape[2]).T,
            "regressor": model.joint_regressor.toarray(),
            "weights": model.weights,
        }
        for name, array in arrays.items():
            self.register_buffer(name, torch.as_tensor(np.ascontiguousarray(array), dtype=dtype), persistent=False)
        self.register_buffer("parents", torch.as_tensor(model.parents), persistent=False)

    def forward(
        self, shape: torch.Tensor, expression: torch.Tensor, pose: torch.Tensor, translation: torch.Tensor
    ) -> tuple[torch.Tensor, torch.Tensor]:
        """vertices [frame,V,3] and joints [frame,55,3] m; shape [frame or 1,S], expression [frame or 1,E], pose [frame,55,3] rad,
        translation [frame,3] m."""
        n = len(pose)
        coefficients = torch.cat([shape.expand(n, -1), expression.expand(n, -1)], dim=1)
        template = self.template.expand(n, -1, -1)
        vertices, joints = lbs(
            coefficients, pose.reshape(n, -1), template, self.directions, self.correctives, self.regressor, self.parents, self.weights
        )
        return vertices + translation[:, None], joints + translation[:, None]
