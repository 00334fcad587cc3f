"""The pages: what was never seen is grey, not without error; evidence is linked where it lies; plots are the same bytes every time."""

import base64
import re

import cv2
import numpy as np
import pytest
from matplotlib.figure import Figure

from tasks.gap.constancy import Constancy, cochran
from tasks.geometry.cameras import Cameras
from tasks.geometry.parts import SKIN
from tasks.report.gap_page import constancy_section
from tasks.report.page import Section, Table, page
from tasks.report.pictures import figure_uri
from tasks.report.sections import cause_section, gap_section, tracking_section

TABLES = {"zones": [], "directions_mm": {}, "bands": [], "frame_mm": [1.0, 1.0]}


def shown(residual_mm):
    """(colour [n, 3] of the middle of each of n squares side by side, caption); residual_mm [2, n] at all corners of a square."""
    squares = residual_mm.shape[1]
    corner = np.array([[0, 0], [0, 1], [1, 1], [1, 0.0]])
    x = np.concatenate([np.column_stack([corner + np.array([k, 0]), np.zeros(4)]) for k in range(squares)])
    faces = np.concatenate([np.array([[0, 1, 2], [0, 2, 3]]) + 4 * k for k in range(squares)]).astype(np.int32)
    image, camera = black(squares)
    heat, _ = gap_section(image, camera, 0, x, faces, np.repeat(residual_mm, 4, axis=1), TABLES, 25.0).figures
    return decoded(heat)[20, 20::40].astype(int), heat.caption


def black(squares):
    """A black picture of metre squares side by side, 40 pixels each, and its camera, a metre in front of them."""
    K, t = np.array([[[40.0, 0, 0], [0, 40, 0], [0, 0, 1]]]), np.array([[0.0, 0, 1]])
    camera = Cameras(("front",), K, np.eye(3)[None], t, np.array([[40 * squares, 40]]), np.zeros((1, 5)))
    return np.zeros((40, 40 * squares, 3), np.uint8), camera


def decoded(figure):
    return cv2.imdecode(np.frombuffer(base64.b64decode(figure.uri.split(",")[1]), np.uint8), cv2.IMREAD_COLOR_RGB)


def test_what_was_never_seen_is_grey():
    """By hand: rms of (3, 4) is 3.5 mm; what was seen once has the error it had then."""
    colour, caption = shown(np.array([[np.nan, 0, 3, 2], [np.nan, 0, 4, np.nan]]))
    assert colour[0] == pytest.approx(128, abs=6)
    assert colour[1].max() < 20  # no error is black
    assert colour[2].max() > 150 and np.ptp(colour[3]) > 60  # inferno, not grey
    assert "yellow 3.5 mm" in caption


def test_what_was_never_seen_does_not_lower_the_scale():
    """Of thirty squares one was seen: its error is the 95th percentile of what is known."""
    assert "yellow 5.0 mm" in shown(np.where(np.arange(30) == 7, 5.0, np.nan) * np.ones((2, 1)))[1]


def test_a_gap_of_which_nothing_was_seen_is_drawn_all_the_same():
    colour, caption = shown(np.full((2, 4), np.nan))
    assert colour == pytest.approx(128, abs=6)
    assert "yellow 0.0 mm" in caption


@pytest.mark.parametrize("seen", [False, True])
def test_skin_in_front_of_cloth_is_drawn_only_where_it_was_seen(seen):
    """A square of cloth, and skin 2 cm in front of it in the second frame."""
    square = np.array([[0, 0, 0], [0, 1, 0], [1, 1, 0], [1, 0.0, 0]])
    x = np.stack([np.concatenate([square, square + np.array([0, 0, z])]) for z in (0.02, -0.02)])
    faces, part = np.array([[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]]), np.array(["skirt", "skirt", SKIN, SKIN])
    known = np.ones((2, 8), bool)
    known[1, 4:] = seen
    image, camera = black(1)
    (figure,) = tracking_section([image], camera, 1, x, faces, part, np.zeros(2), known, np.ones((2, 8))).figures
    picture = decoded(figure)
    colour = picture[picture.shape[0] // 2, picture.shape[1] // 2].astype(int)
    assert (np.ptp(colour) < 12) == seen  # skin is grey, cloth is not
    assert colour.max() > 60


def test_the_evidence_is_linked_where_it_lies_beside_the_page():
    answer = {"ranking": [], "verdict": {"kind": "none"}, "where": {"zones": []}, "garment": "skirt", "record_next": "a turn"}
    linked = page("ann", "one", "none", [cause_section(answer, [("all of it", "gap.html")])])
    assert '<a href="gap.html">all of it</a>' in linked
    assert "href" not in page("ann", "one", "none", [cause_section(answer, [])])  # an artifact of before there was any


def test_what_is_unknown_is_a_dash():
    cells = page("a", "b", "c", [Section("d", tables=[Table(["e"], [[None], [float("nan")], [0.0], ["nan"]])])])
    assert re.findall(r"<td[^>]*>([^<]*)</td>", cells) == ["–", "–", "0", "nan"]


def test_the_same_plot_gives_the_same_bytes():
    """Else the same diagnosis would be another artifact every time."""

    def plotted():
        canvas = Figure()
        canvas.add_subplot().plot([0, 1], [1, 0], clip_on=True)
        return figure_uri(canvas)

    assert plotted() == plotted()


def constancy(places, multiples):
    m = np.array(multiples, float)
    return Constancy(places, m, np.full(len(m), 0.1), *cochran(m, np.full(len(m), 0.1)))


def test_too_few_windows_for_a_grouping_are_said_not_drawn():
    """By hand: multiples 1 and 1.2, each ± 0.1, have Q = 2 on one degree of freedom."""
    windows, nothing = constancy(("1", "2"), [1.0, 1.2]), constancy((), [])
    short = constancy_section({"window": {"wind": windows}, "speed": {"wind": nothing}}, {"wind": {"window": windows, "speed": nothing}})
    assert short.paragraphs[-1] == "Too few windows to tell by speed."
    (table,) = short.tables
    assert table.columns == ["effect alone", "scatter by window, √(Q/dof)"] and table.rows == [["wind", pytest.approx(2**0.5)]]
    assert len(short.figures) == 1
    whole = constancy_section(
        {"window": {"wind": windows}}, {"wind": {"window": windows, "speed": constancy(("slow", "fast"), [1.0, 0.5])}}
    )
    assert whole.tables[0].columns[2:] == ["scatter by speed, √(Q/dof)", "multiple, slow", "multiple, fast"]
    assert len(whole.paragraphs) == 1 and whole.tables[0].rows[0][3:] == [1.0, 0.5]
