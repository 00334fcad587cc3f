"""One picture: the right pixels in the right order, and no damage passed on in silence."""

import cv2
import numpy as np
import pytest
from PIL import Image

from tasks.capture.images import picture_fault, read_header, read_mask, read_rgb
from tasks.geometry.faults import BadInput
from tests.capture.recordings import mask_of


@pytest.fixture
def jpeg(tmp_path):
    y, x = np.mgrid[:120, :200]
    rgb = np.stack([255 * (x > 100), y * 2, np.full_like(x, 30)], -1).astype(np.uint8)
    path = tmp_path / "a.jpg"
    Image.fromarray(rgb).save(path, quality=95, subsampling=0)
    return path, rgb


def test_order_is_red_green_blue(jpeg):
    path, rgb = jpeg
    assert np.abs(read_rgb(path).astype(int) - rgb).mean() < 2
    assert np.abs(cv2.imread(str(path)).astype(int) - rgb).mean() > 50  # the control: OpenCV's order is the other one


def test_header_without_decoding_both_kinds(jpeg, tmp_path):
    path, _ = jpeg
    assert read_header(path) == (200, 120, "JPEG")
    Image.open(path).save(tmp_path / "a.png")
    assert read_header(tmp_path / "a.png") == (200, 120, "PNG")
    Image.open(path).save(tmp_path / "p.jpg", progressive=True)
    assert read_header(tmp_path / "p.jpg") == (200, 120, "JPEG")


@pytest.mark.parametrize("keep", [0.3, 0.6, 0.95])
def test_a_truncated_jpeg_is_refused_where_opencv_pads_it(jpeg, keep):
    path, _ = jpeg
    whole = path.read_bytes()
    assert picture_fault(path, (200, 120)) is None
    path.write_bytes(whole[: int(len(whole) * keep)])
    assert "decoded" in picture_fault(path, (200, 120)).what
    assert cv2.imread(str(path)) is not None
    with pytest.raises(BadInput, match="truncated"):
        read_rgb(path)


def test_a_jpeg_with_bytes_after_its_end_is_still_a_picture(jpeg):
    path, _ = jpeg
    path.write_bytes(path.read_bytes() + b"maker's notes" * 20)
    assert picture_fault(path, (200, 120)) is None


def test_exif_orientation_does_not_turn_the_picture(jpeg, tmp_path):
    _, rgb = jpeg
    exif = Image.Exif()
    exif[0x0112] = 6
    Image.fromarray(rgb).save(tmp_path / "turned.jpg", exif=exif)
    assert read_rgb(tmp_path / "turned.jpg").shape == rgb.shape
    assert cv2.imread(str(tmp_path / "turned.jpg")).shape == (200, 120, 3)


def test_masks_keep_channel_zero_and_empty_ones_are_found(tmp_path):
    m = np.zeros((1000, 800), np.uint8)
    path = tmp_path / "m.png"
    for level in (1, 6, 9):
        Image.fromarray(m).save(path, compress_level=level)
        assert "empty" in picture_fault(path, (800, 1000), mask=True).what
    m[500, 400] = 255
    Image.fromarray(np.stack([m, 0 * m, 0 * m], -1)).save(path)
    assert picture_fault(path, (800, 1000), mask=True) is None
    assert read_mask(path).sum() == 1


def test_opencv_masks_empty_at_full_size(tmp_path):
    cv2.imwrite(str(tmp_path / "m.png"), np.zeros((3008, 4112), np.uint8))
    assert "empty" in picture_fault(tmp_path / "m.png", (4112, 3008), mask=True).what


SHAPE = mask_of(80, 60)  # 255 on the actor
WHITE = np.full((60, 80), 255, np.uint8)


@pytest.mark.parametrize(
    ("mode", "channels", "says"),
    [
        ("L", [SHAPE // 255], "with 1 as the largest value in channel 0; masks are 0 to 255, above 127 is the actor"),
        ("RGB", [SHAPE // 2, SHAPE, SHAPE], "with 127 as the largest value in channel 0"),
        ("RGBA", [0 * SHAPE, 0 * SHAPE, 0 * SHAPE, SHAPE], "in the alpha channel alone"),
        ("RGBA", [WHITE, WHITE, WHITE, SHAPE], "in the alpha channel alone"),
        ("RGBA", [0 * SHAPE, 0 * SHAPE, 0 * SHAPE, WHITE], "an empty mask"),
        ("L", [0 * SHAPE], "an empty mask"),
        ("RGBA", [SHAPE, SHAPE, SHAPE, SHAPE], None),
        ("RGBA", [SHAPE, SHAPE, SHAPE, WHITE], None),
        ("L", [WHITE], None),
    ],
)
def test_a_mask_in_which_nobody_is_seen_says_why(tmp_path, mode, channels, says):
    path = tmp_path / "m.png"
    Image.merge(mode, [Image.fromarray(c) for c in channels]).save(path)
    fault = picture_fault(path, (80, 60), mask=True, deep=True)
    assert fault is None if says is None else says in fault.what
    assert says is None or ("Segment the frame again" in fault.remedy) == ("empty" in says)


@pytest.mark.parametrize(
    "content", [b"", b"\xff\xd8", b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR", b"GIF89a" + b"\0" * 50, b"\xff\xd8" + b"\xff" * 4000]
)
def test_not_a_picture(tmp_path, content):
    path = tmp_path / "x.jpg"
    path.write_bytes(content)
    for call in (read_header, read_rgb, read_mask):
        with pytest.raises(BadInput, match=r"x\.jpg"):
            call(path)


def test_a_promise_of_too_many_pixels_is_not_decoded(jpeg, tmp_path):
    path, _ = jpeg
    Image.open(path).save(tmp_path / "big.png")
    content = bytearray((tmp_path / "big.png").read_bytes())
    content[16:24] = b"\0\1\0\0\0\1\0\0"
    (tmp_path / "big.png").write_bytes(content)
    with pytest.raises(BadInput, match="65536 x 65536"):
        read_rgb(tmp_path / "big.png")


def test_sixteen_bit_pictures_are_named(tmp_path):
    Image.fromarray(np.full((5, 5), 40000, np.uint16)).save(tmp_path / "x.png")
    with pytest.raises(BadInput, match="pixel type I;16"):
        read_mask(tmp_path / "x.png")
