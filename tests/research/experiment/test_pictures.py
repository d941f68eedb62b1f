"""The experiment's pictures: what is drawn and in which colour, what is written, and that it is the same every time."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from occlusion_builder import elliptic_hole
from surface_builder import FACING_X, kinect, star

from anchorpose.research.experiment.correspondence import TruePlaces
from anchorpose.research.experiment.method import Family, Method
from anchorpose.track_tree.tree import Support, TrackResult

pytest.importorskip("matplotlib")

from anchorpose.research.experiment.pictures import album, canvas, matches, regions

VIEW = canvas.upright_view(kinect())
BODY = star({"head": (0.0, 0.5), "left": (0.5, 0.1), "right": (-0.5, 0.1), "legs": (0.0, -0.8)})
COUNT = len(BODY)
BLUE, VERMILLION = (0, 114, 178), (213, 94, 0)


def moment_of(place_m: np.ndarray | None = None, seen: np.ndarray | None = None) -> SimpleNamespace:
    """Two frames of a body that stands still, unless it is said where its nodes are in the second."""
    place = BODY.points_m.astype(np.float64) if place_m is None else place_m
    truth = TruePlaces(np.arange(COUNT), place, np.ones(COUNT, bool) if seen is None else seen)
    return SimpleNamespace(name="whole", title="Nothing hidden", truth=truth, surfaces=(BODY, BODY), window=None)


def said(match: np.ndarray, subset: np.ndarray, subsets: np.ndarray, node: np.ndarray | None = None) -> SimpleNamespace:
    """What a method says: every subset leads to the same match."""
    node = np.arange(COUNT) if node is None else node
    support = np.where(match[node] >= 0, Support.MATCHED, Support.NO_HYPOTHESIS).astype(np.int8)
    tree = TrackResult(match[node], np.zeros(len(node), np.float32), subset[node], support, 0)
    link = SimpleNamespace(subsets=subsets, match=np.repeat(match[:, None], len(subsets), axis=1))
    return SimpleNamespace(direct=np.zeros(COUNT, np.int32), links=(link,), tree=SimpleNamespace(node=node, tree=tree))


def pairs_from(monkeypatch: pytest.MonkeyPatch, direct: np.ndarray, moment: SimpleNamespace, **method) -> matches.Pairs:
    answer = said(direct, np.zeros(COUNT, np.int32), np.empty((1, 0), np.int64))
    answer.direct = direct
    monkeypatch.setattr(matches, "match_window", lambda *_: answer)
    given = {
        "key": "m",
        "title": "A method",
        "family": Family.LOCAL,
        "source": "",
        "associate": lambda _: None,
        **method,
    }
    return matches.pairs_of(Method(**given), None, moment)


# the view


def test_the_view_is_level_and_not_mirrored_however_the_camera_is_mounted() -> None:
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


def test_a_camera_that_looks_straight_down_has_no_upright_view() -> None:
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
    pairs = pairs_from(monkeypatch, direct, moment_of(place))
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


@pytest.mark.slow
def test_the_whole_album_of_a_simulated_recording(tmp_path: Path) -> None:
    from anchorpose.motion.database import SHIPPED
    from anchorpose.recording.reader import open_recording
    from anchorpose.research.experiment.clips import cut_holes
    from anchorpose.research.experiment.config import Form
    from anchorpose.research.experiment.correspondence import Skin
    from anchorpose.research.experiment.framework import paper_room, run_in
    from anchorpose.research.experiment.given import GivenFrames, make_reference
    from anchorpose.research.experiment.method import load_methods
    from anchorpose.research.experiment.work import Trial
    from anchorpose.simulate import config as presets
    from anchorpose.simulate.write import simulate_recording
    from anchorpose.tracker.config import TrackConfig

    simulation = presets.single(401, 2.0, 10.0)
    simulate_recording(tmp_path / "made", simulation)
    recording = open_recording(tmp_path / "made" / "recording")
    reference = make_reference(recording, TrackConfig())
    frame = int(np.flatnonzero(reference.found[:-4])[-1]) + 1
    chosen = np.arange(20) >= frame
    cut_holes(recording, tmp_path / "holed", reference.centre_m, chosen, 0.09)
    methods, room = load_methods(("fpfh", "anchors", "none")), paper_room(recording, reference, SHIPPED)
    uncut, holed_room = GivenFrames(room, reference), replace(room, recording=open_recording(tmp_path / "holed"))
    holed = GivenFrames(holed_room, reference, uncut, chosen)
    trials = [
        Trial(given.room.recording, given, cut, {Form.REFINED: run_in(given.room, SHIPPED)})
        for given, cut in ((uncut, np.zeros(20, bool)), (holed, chosen))
    ]
    settings = {method.key: method.settings[0] for method in methods}
    prepared = SimpleNamespace(recording=recording, reference=reference, skin=Skin(simulation))
    plan = SimpleNamespace(methods=methods, settings=settings)
    written = []
    for out in (tmp_path / "one", tmp_path / "other"):
        out.mkdir()
        album.write_pictures(out, prepared, *trials, frame, plan)
        written.append({path.name: path.read_bytes() for path in out.iterdir()})
    assert written[0] == written[1]
    contents = json.loads(written[0].pop("pictures.json"))
    assert {entry["file"] for entry in contents} == set(written[0])
    assert {entry["section"] for entry in contents} == {"matches", "match", "tracked", "hypotheses", "regions"}
    assert all(entry["caption"] for entry in contents)
    assert {"matches-whole.png", "matches-hole.png", "matches-hole-fpfh.png", "tracked.png"} <= set(written[0])
    assert "matches-whole-none.png" not in written[0]
    with pytest.raises(ValueError, match="frame before"):
        album.write_pictures(tmp_path, prepared, *trials, 0, plan)
