"""The replay of a whole scene by a model that has effects beside the base.

An effect may remember what the cloth went through, so a replay that fails begins anew with twice the substeps; it does not go on from its
last good frame as a replay of the base model does (`perseverance.py`).
"""

from dataclasses import replace

import numpy as np

from tasks.cloth.scene import Replay, Scene
from tasks.effects.effect import Motion
from tasks.effects.model import Model
from tasks.simulator import Frame
from tasks.simulator.newton import CONVERGED


def replay_completed(scene: Scene, model: Model) -> Replay:
    """Simulate the scene as the cloth is, not as a tracker with the model's faults would see it."""
    reasons = []
    for attempt in range(scene.patience.attempts):
        settings = replace(scene.settings, substeps=scene.settings.substeps * 2**attempt)
        frames, ending = _walked(scene, replace(model, settings=settings))
        if ending == CONVERGED:
            break
        reasons.append(f"attempt {attempt + 1}, {settings.substeps} substeps, after frame {len(frames) - 1}: {ending}")
    newton, seconds = sum(f.newton_iterations for f in frames), sum(f.seconds for f in frames)
    return Replay(np.stack([f.x for f in frames]), {}, newton, ending, tuple(reasons), seconds)


def _walked(scene: Scene, model: Model) -> tuple[list[Frame], str]:
    """Good frames (the start, good or not, is among them), and how it ended."""
    frames = []
    for frame in model.run(Motion(scene.collider_motion, scene.boundary_motion), scene.x0, scene.v0):
        if not frame.converged:
            return frames or [frame], frame.ending
        frames.append(frame)
        if frame.seconds > scene.patience.frame_s and len(frames) < len(scene.observed):
            return frames, f"slow: the frame took {frame.seconds:.0f} s, {scene.patience.frame_s:.0f} s are allowed"
    return frames, CONVERGED
