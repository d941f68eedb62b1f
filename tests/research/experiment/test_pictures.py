"""The experiment's pictures: what is drawn and in which colour, what is written, and that it is the same every time."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from occlusion_builder import elliptic_hole
from surface_builder import FACING_X, kinect, star

from anchorpose.research.experiment.correspondence import TruePlaces
from anchorpose.research.experiment.method import Family, Method
from anchorpose.track_tree.tree import Support, TrackResult

pytest.importorskip("matplotlib")

from anchorpose.research.experiment.pictures import canvas, matches, regions

VIEW = canvas.upright_view(kinect())
BODY = star({"head": (0.0, 0.5), "left": (0.5, 0.1), "right": (-0.5, 0.1), "legs": (0.0, -0.8)})
COUNT = len(BODY)


def said(match: np.ndarray) -> SimpleNamespace:
    """What a method says of every node, by one subset."""
    support = np.where(match >= 0, Support.MATCHED, Support.NO_HYPOTHESIS).astype(np.int8)
    tree = TrackResult(match, np.zeros(COUNT, np.float32), np.zeros(COUNT, np.int32), support)
    link = SimpleNamespace(subsets=np.empty((1, 0), np.int64), match=match[:, None])
    return SimpleNamespace(direct=match, links=(link,), tree=SimpleNamespace(node=np.arange(COUNT), tree=tree))


# the view


def test_the_view_is_level_and_not_mirrored_unless_the_camera_looks_straight_down() -> None:
    turn = np.eye(4)
    turn[:3, :3] = [[0, -1, 0], [1, 0, 0], [0, 0, 1]]  # on its side
    tilt = np.eye(4)
    tilt[1:3, 1:3] = [[np.cos(0.4), -np.sin(0.4)], [np.sin(0.4), np.cos(0.4)]]
    for mounted in (FACING_X, FACING_X @ turn, FACING_X @ tilt):
        view = canvas.upright_view(kinect(T_world_camera=mounted))
        np.testing.assert_allclose(view.axes, [[0, 0, -1], [0, 1, 0], [1, 0, 0]], atol=1e-12)
    left, up, near = np.array([0.0, 0, -1]), np.array([0.0, 1, 0]), np.array([1.0, 0, 0])
    np.testing.assert_allclose(VIEW.flat_m(np.array([left, up])), [[1, 0], [0, 1]], atol=1e-12)
    assert VIEW.near_m(near) == pytest.approx(1.0)
    down = np.eye(4)
    down[:3, :3] = [[1, 0, 0], [0, 0, -1], [0, 1, 0]]
    with pytest.raises(ValueError, match="straight down"):
        canvas.upright_view(kinect(T_world_camera=down))


# matches


def test_a_pair_is_right_within_five_centimetres_of_the_true_place(monkeypatch: pytest.MonkeyPatch) -> None:
    place = BODY.points_m.astype(np.float64)
    place[:100, 1] += 0.049
    place[100:200, 1] += 0.051
    place[200] = np.nan
    direct = np.arange(COUNT)
    direct[300:350] = -1
    truth = TruePlaces(np.arange(COUNT), place, np.ones(COUNT, bool))
    moment = SimpleNamespace(name="whole", title="Nothing hidden", truth=truth, surfaces=(BODY, BODY), window=None)
    monkeypatch.setattr(matches, "match_window", lambda *_: said(direct))
    method = Method(key="m", title="A method", family=Family.LOCAL, source="", associate=lambda _: None)
    pairs = matches.pairs_of(method, None, moment)
    assert pairs.right[:100].all()
    assert not pairs.right[100:201].any()
    assert pairs.right[201:300].all()
    assert not pairs.right[300:350].any()
    assert np.isnan(pairs.error_m[[200, 320]]).all()
    np.testing.assert_allclose(pairs.error_m[100:200], 0.051, atol=1e-6)


# regions


def holed(hidden: np.ndarray, surface) -> regions.HoledFrame:
    taken = np.zeros((60, 60), bool)
    row, column = surface.pixel[hidden].T
    taken[row, column] = True
    anchors = SimpleNamespace(node=np.array([0, 30, -1, len(surface) - 1, len(surface) // 2]))
    return regions.HoledFrame("Frame 3", surface, anchors, taken, surface.points_m[len(surface) // 2])


def test_the_hole_hides_the_nodes_whose_pixels_it_took_and_no_other_cameras() -> None:
    sheet = elliptic_hole()
    np.testing.assert_array_equal(holed(sheet.hidden, sheet.whole).hidden, sheet.hidden)
    other = np.arange(len(sheet.whole)) % 2 == 1
    mixed = replace(sheet.whole, camera=other.astype(np.uint8))  # it has nodes at the same pixels of its own picture
    np.testing.assert_array_equal(holed(sheet.hidden, mixed).hidden, sheet.hidden & ~other)


def test_only_anchors_that_are_found_and_seen_shed_light() -> None:
    sheet = elliptic_hole()
    assert list(regions.lights_of(holed(sheet.hidden, sheet.whole), sheet.hidden)) == ["Head", "HandLeft", "FootLeft"]
    nothing = np.zeros(len(sheet.whole), bool)
    assert regions.lights_of(holed(sheet.hidden, sheet.whole), nothing) == {}
    assert regions.region_pictures(VIEW, holed(nothing | (np.arange(len(nothing)) < 0), sheet.whole)) == []
