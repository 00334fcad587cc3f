"""Training: weights of the loss, what augmentation does to labels, and that a short run learns."""

import numpy as np
import pytest
import torch

from tasks.body.wholebody import FLIP
from tasks.keypoints.augmentation import augmented
from tasks.keypoints.network import WholeBodyNet
from tasks.keypoints.pictures import read_shard, write_shards
from tasks.keypoints.renders import Picture
from tasks.keypoints.train import batch_loss, train


class Dots:
    """Stands for the studio: each keypoint is a dot, bright on dark, its colour telling which limb; quick to draw, easy to learn."""

    def __init__(self):
        self.bystanders = []

    def person(self, random):
        return random.uniform((60, 60), (196, 260), (133, 2))

    def picture(self, person, random):
        image = np.full((320, 256, 3), 20, np.uint8)
        shade = np.random.default_rng(0).integers(60, 256, (133, 3))
        for k, (u, v) in enumerate(person):
            image[int(v) - 2 : int(v) + 3, int(u) - 2 : int(u) + 3] = shade[k]
        return Picture(image, person, np.ones(133, bool))


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.setattr("tasks.keypoints.pictures.SHARD", 24)
    write_shards(Dots(), tmp_path / "pictures", range(2), seed=0)
    return tmp_path / "pictures"


def test_shards_hold_what_was_drawn_and_are_not_made_twice(folder):
    shard = read_shard(folder / "shard_0001.npz")
    assert len(shard) == 24
    picture = shard.picture(5)
    for u, v in picture.keypoints[:17]:
        assert picture.image[int(v), int(u)].max() > 50
    before = (folder / "shard_0001.npz").stat().st_mtime_ns
    write_shards(Dots(), folder, range(2), seed=99)
    assert (folder / "shard_0001.npz").stat().st_mtime_ns == before


def test_labels_follow_the_picture_through_augmentation():
    """A white disc is where its label says, mirrored or not. A missing half pixel would show as 1 px in mirrored pictures."""
    random, off = np.random.default_rng(3), {True: [], False: []}
    y, x = np.mgrid[:256, :192] + 0.5
    v, u = np.mgrid[:320, :256] + 0.5
    for _ in range(120):
        at = random.uniform((90, 110), (166, 210))
        keypoints = np.tile([128.0, 160.0], (133, 1))
        keypoints[[0, 9]] = at  # nose and left wrist in one place; after mirroring the place is that of nose and right wrist
        image = np.zeros((320, 256, 3), np.uint8)
        image[(u - at[0]) ** 2 + (v - at[1]) ** 2 < 36] = 255
        crop, moved, visible = augmented(image, keypoints, np.ones(133, bool), FLIP, random)
        mirrored = not np.allclose(moved[9], moved[0])
        assert np.allclose(moved[10 if mirrored else 9], moved[0])
        bright = crop.astype(float).sum(2)
        weight = np.clip(bright - np.median(bright) - 100, 0, None) * (np.hypot(x - moved[0, 0], y - moved[0, 1]) < 14)
        if visible[0] and (moved[0] > 15).all() and (moved[0] < (177, 241)).all() and weight.sum() > 5000:
            off[mirrored].append([(weight * x).sum() / weight.sum() - moved[0, 0], (weight * y).sum() / weight.sum() - moved[0, 1]])
    for case in off.values():
        assert len(case) > 25
        assert np.abs(np.median(case, axis=0)).max() < 0.25


def test_mirroring_swaps_left_and_right():
    """Mirroring turns the sense of rotation round, swapping the wrists turns it back: nose to left to right wrist never changes sense."""
    random, keypoints = np.random.default_rng(4), np.tile([128.0, 160.0], (133, 1))
    keypoints[0], keypoints[9], keypoints[10] = (128, 100), (170, 180), (90, 170)
    sense = []
    for _ in range(20):
        moved = augmented(np.zeros((320, 256, 3), np.uint8), keypoints, np.ones(133, bool), FLIP, random)[1]
        a, b = moved[9] - moved[0], moved[10] - moved[0]
        sense.append(np.sign(a[0] * b[1] - a[1] * b[0]))
    assert set(sense) == {1.0}


def test_a_keypoint_of_weight_zero_does_not_matter():
    torch.manual_seed(0)
    net = WholeBodyNet().eval()
    crops, keypoints, weight = torch.randn(2, 3, 128, 96), torch.rand(2, 133, 2) * 90, torch.ones(2, 133)
    weight[:, 7] = 0
    moved = keypoints.clone()
    moved[:, 7] += 30
    assert batch_loss(net, crops, keypoints, weight).item() == batch_loss(net, crops, moved, weight).item()
    moved[:, 8] += 30
    assert batch_loss(net, crops, keypoints, weight).item() != batch_loss(net, crops, moved, weight).item()


@pytest.mark.slow
def test_a_short_run_learns_and_leaves_a_model(folder, tmp_path):
    torch.set_num_threads(1)
    log = []
    train(tmp_path / "net.onnx", folder, FLIP, minutes=0.5, batch=8, size=(96, 128), report=log.append)
    assert (tmp_path / "net.onnx").exists() and (tmp_path / "net.pt").exists()
    assert log[-1].loss < 0.8 * log[0].loss
    again = []
    train(tmp_path / "more.onnx", folder, FLIP, minutes=0.03, batch=8, size=(96, 128), resume=tmp_path / "net.pt", report=again.append)
    assert again[0].loss < 0.9 * log[0].loss
