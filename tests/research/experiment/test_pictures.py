"""The experiment's pictures: what is drawn and in which colour, what is written, and that it is the same every time."""

from __future__ import annotations

import json
import sys
from dataclasses import replace
from io import BytesIO
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from occlusion_builder import elliptic_hole
from surface_builder import FACING_X, flat_grid, kinect, no_links, star

from anchorpose.errors import AnchorposeError, MissingPackage
from anchorpose.research.experiment.clips import Clip
from anchorpose.research.experiment.config import quick
from anchorpose.research.experiment.correspondence import TruePlaces
from anchorpose.research.experiment.method import Family, Method
from anchorpose.research.experiment.plan import Plan, PlanSpec, experiment_code
from anchorpose.research.experiment.results import PaperTimes
from anchorpose.research.experiment.run import training_clips
from anchorpose.track_tree.tree import Support, TrackResult

pytest.importorskip("matplotlib")

from anchorpose.research.experiment.pictures import album, canvas, hypotheses, matches, regions, tracked

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


def hex_to_rgb(colour: str) -> tuple[int, ...]:
    return tuple(int(colour[i : i + 2], 16) for i in (1, 3, 5))


def figure_axes():
    return canvas.blank_figure(3.0, 3.0).add_subplot()


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


def test_one_per_cent_of_the_known_nodes_is_drawn_and_always_the_same() -> None:
    known = np.arange(1000) % 3 > 0
    drawn = matches.draw_nodes(known)
    assert len(drawn) == 10
    assert known[drawn].all()
    assert len(set(drawn)) == 10
    np.testing.assert_array_equal(drawn, matches.draw_nodes(known))
    assert np.ptp(drawn) > 300  # over the whole body, not its first nodes
    assert len(matches.draw_nodes(np.zeros(50, bool))) == 0


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


def test_shares_are_of_the_nodes_whose_true_place_is_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    seen = np.arange(COUNT) < 400
    place = BODY.points_m.astype(np.float64)
    place[:100] += 1.0
    direct = np.where(np.arange(COUNT) < 150, np.arange(COUNT), -1)
    moment = moment_of(place, seen)
    pairs = pairs_from(monkeypatch, direct, moment)
    assert matches.describe_pairs(pairs, moment) == "12 % right, 25 % wrong, 62 % no match"
    assert matches.describe_pairs(pairs, moment_of(place, ~np.isfinite(place[:, 0]))) == "no true place is known"


@pytest.mark.parametrize(
    ("share", "text"), [(0.0, "0 %"), (0.004, "< 1 %"), (0.5, "50 %"), (0.996, "> 99 %"), (1.0, "100 %")]
)
def test_none_and_all_are_said_only_where_it_is_so(share: float, text: str) -> None:
    assert matches.percent(share) == text


def test_lines_are_blue_and_solid_where_right_vermilion_and_dashed_where_wrong(monkeypatch: pytest.MonkeyPatch) -> None:
    moment = moment_of()
    node = matches.draw_nodes(np.ones(COUNT, bool))
    direct = np.arange(COUNT)
    wrong, none = node[::2], node[1:2]
    direct[wrong] = (wrong + COUNT // 2) % COUNT
    direct[none] = -1
    pairs = pairs_from(monkeypatch, direct, moment)
    axes = figure_axes()
    matches.draw_pairs(axes, VIEW, moment, pairs)
    bad, good = axes.collections[2:4]
    assert [tuple(np.rint(255 * each.get_colors()[0, :3])) for each in (bad, good)] == [VERMILLION, BLUE]
    assert bad.get_linestyles()[0][1] is not None
    assert good.get_linestyles()[0][1] is None
    assert len(bad.get_segments()) == len(wrong)
    right = np.setdiff1d(node, np.concatenate([wrong, none]))
    shift_m = canvas.apart_m(VIEW, BODY, BODY)
    ends = np.stack([VIEW.flat_m(BODY.points_m[right]), VIEW.flat_m(BODY.points_m[direct[right]], shift_m)], axis=1)
    np.testing.assert_allclose(good.get_segments(), ends, atol=1e-6)
    ring = axes.lines[-1]
    np.testing.assert_allclose(np.transpose(ring.get_data()), VIEW.flat_m(BODY.points_m[none]), atol=1e-6)


def test_the_tree_chooses_among_several_hypotheses_and_one_is_taken_as_it_is() -> None:
    match, subset = np.arange(COUNT, dtype=np.int32), np.zeros(COUNT, np.int32)
    single = said(match, subset, np.empty((1, 0), np.int64))
    assert matches.chosen_match(single)[0] is single.direct
    on_body = np.arange(0, COUNT, 2)
    several = said(match, subset, np.array([[0, 1], [0, 2]]), on_body)
    chosen, by_tree = matches.chosen_match(several)
    assert by_tree
    np.testing.assert_array_equal(chosen[on_body], on_body)
    assert (np.delete(chosen, on_body) == -1).all()


def test_a_method_without_pairs_is_drawn_unless_it_means_to_have_none(monkeypatch: pytest.MonkeyPatch) -> None:
    nothing = np.full(COUNT, -1)
    assert pairs_from(monkeypatch, nothing, moment_of(), associate=None) is None
    assert pairs_from(monkeypatch, nothing, moment_of(), family=Family.NONE) is None
    assert matches.describe_pairs(pairs_from(monkeypatch, nothing, moment_of()), moment_of()).endswith("100 % no match")


def test_the_sheet_has_the_papers_order_and_then_the_others() -> None:
    keys = ("gmds", "anchors", "wks", "fpfh", "ld-sift", "shot", "rops")
    pairs = [matches.Pairs(key, key, np.arange(COUNT), np.zeros(COUNT)) for key in keys]
    order = [each.key for each in matches.in_paper_order(pairs)]
    assert order == ["fpfh", "rops", "shot", "wks", "anchors", "gmds", "ld-sift"]
    pictures = matches.match_pictures(VIEW, moment_of(), pairs)
    assert [each.file for each in pictures] == [*(f"matches-whole-{key}.png" for key in keys), "matches-whole.png"]
    assert [axes.get_title().split("\n")[0] for axes in pictures[-1].figure.axes] == order


# hypotheses


def test_nodes_have_the_colour_of_their_subset_on_both_sides() -> None:
    subset = (np.arange(COUNT) % 3).astype(np.int32) - 1  # a third is missed
    match = np.where(subset >= 0, np.arange(COUNT), -1).astype(np.int32)
    axes = figure_axes()
    hypotheses.draw_chosen(axes, VIEW, moment_of(), said(match, subset, np.array([[0, 1, 2], [0, 3, 4]])))
    missed, *drawn = axes.lines
    assert missed.get_label() == "no match (33 %)"
    assert [line.get_label() for line in drawn] == [
        "head, left hand, right hand (33 %)",
        "head, left foot, right foot (33 %)",
    ]
    shift_m = canvas.apart_m(VIEW, BODY, BODY)
    for number, line in enumerate(drawn):
        nodes = BODY.points_m[subset == number]
        places = np.concatenate([VIEW.flat_m(nodes), VIEW.flat_m(nodes, shift_m)])
        np.testing.assert_allclose(np.transpose(line.get_data()), places, atol=1e-6)
        assert line.get_color() == hypotheses.COLOURS[number]
    assert len({line.get_marker() for line in drawn}) == len(drawn)


def test_ten_subsets_and_two_behind_a_cut_have_colours_and_markers_of_their_own() -> None:
    assert len(set(hypotheses.COLOURS)) == len(set(hypotheses.MARKERS)) == 12


def test_every_possible_match_of_a_few_nodes_is_drawn_and_the_chosen_one_thick() -> None:
    match = np.arange(COUNT, dtype=np.int32)
    answer = said(match, np.ones(COUNT, np.int32), np.array([[0, 1], [0, 2], [1, 2]]))
    answer.links[0].match[:, 2] = -1
    axes = figure_axes()
    hypotheses.draw_possible(axes, VIEW, moment_of(), answer)
    lines = [line for line in axes.lines if len(line.get_xdata()) == 2]
    assert len(lines) == 2 * hypotheses.NODES
    assert [line.get_linewidth() > 2 for line in lines] == [False] * hypotheses.NODES + [True] * hypotheses.NODES


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


def test_the_border_is_drawn_yellow_where_bright_and_black_where_shadowed() -> None:
    sheet = elliptic_hole()
    light = regions.lights_of(holed(sheet.hidden, sheet.whole), sheet.hidden)["Head"]
    axes = figure_axes()
    regions.draw_light(axes, VIEW, light, 0, "head")
    _, all_of_it, dark, _, bright = axes.collections
    assert len(dark.get_segments()) == len(light.shadowed_boundary.edges) > 0
    assert len(bright.get_segments()) == len(light.bright.edges) > 0
    assert len(all_of_it.get_segments()) == len(light.occlusion.boundary.edges)
    assert [hex_to_rgb(regions.BRIGHT), hex_to_rgb(regions.SHADOWED)] == [
        tuple(np.rint(255 * each.get_colors()[0, :3])) for each in (bright, dark)
    ]
    corner = VIEW.flat_m(sheet.whole.points_m[0])  # the anchor is there, the hole's near side is bright
    ends = [np.linalg.norm(np.array(each.get_segments()) - corner, axis=2).mean() for each in (bright, dark)]
    assert ends[0] < ends[1]


def test_distortion_has_a_colour_beyond_the_tolerance_only_and_another_where_cut_off() -> None:
    colour = regions.colour_of(np.array([0.0, 0.003, np.nan, 0.02, 0.1, 5.0, np.inf]), 0.004)
    np.testing.assert_allclose(colour[:3], np.tile(canvas.BARE, (3, 1)))
    assert colour[3].mean() > colour[4].mean()
    np.testing.assert_allclose(colour[4], colour[5])
    np.testing.assert_allclose(colour[6], regions.CUT_OFF)


def test_a_sheet_cut_in_two_is_reported_as_cut_off() -> None:
    sheet = flat_grid(20, 12, 0.02)
    hidden = sheet.pixel[:, 0] == 10
    light = regions.lights_of(holed(hidden, sheet), hidden)["Head"]
    assert regions.describe_distortion(light, 0.15) == "15 cm: 0 % longer, 47 % cut off"


def test_the_pictures_of_the_regions_say_whether_the_border_is_covered() -> None:
    sheet = elliptic_hole()
    one, everyone, sizes = regions.region_pictures(VIEW, holed(sheet.hidden, sheet.whole))
    assert [each.file for each in (one, everyone, sizes)] == ["regions-anchor.png", "regions.png", "regions-sizes.png"]
    assert "cover" in everyone.caption
    assert {axes.get_title() for axes in everyone.figure.axes} >= {"head", "right hand: not found"}
    assert sum("% longer" in axes.get_title() for axes in sizes.figure.axes) == 5


# tracked


def test_joints_have_a_colour_and_a_marker_each_and_the_error_is_the_mean() -> None:
    rng = np.random.default_rng(5)
    truth = rng.normal(size=(21, 3))
    joints = {"truth": truth, "predicted": truth + np.eye(3)[0] * 0.03, "tracked": truth + np.eye(3)[1] * 0.01}
    frame = tracked.TrackedFrame(7, BODY, joints)
    assert frame.error_m("tracked") == pytest.approx(0.01)
    method = Method(key="anchors", title="anchors", family=Family.PROPOSED, source="")
    picture = tracked.tracked_picture(VIEW, method, [frame], 10.0, 4)
    axes = picture.figure.axes[0]
    assert axes.get_title() == "0.3 s: 10 mm"
    assert "30 mm" in picture.caption
    for kind, colour, marker, _ in tracked.KINDS:
        (line,) = [line for line in axes.lines if line.get_label() == kind]
        assert (line.get_color(), line.get_marker()) == (colour, marker)
        np.testing.assert_allclose(np.transpose(line.get_data()), VIEW.flat_m(joints[kind]))
    assert len({marker for _, _, marker, _ in tracked.KINDS}) == 3
    assert {kind: colour for kind, colour, *_ in tracked.KINDS}["truth"] == canvas.BLUE


# writing


def draw_once() -> bytes:
    with canvas.default_style():
        pairs = matches.Pairs("m", "A method", np.arange(COUNT), np.zeros(COUNT))
        return canvas.as_png(matches.match_pictures(VIEW, moment_of(), [pairs])[0].figure)


def test_the_same_picture_has_the_same_bytes_whatever_the_users_style() -> None:
    import matplotlib

    first = draw_once()
    with matplotlib.rc_context({"font.size": 20.0, "font.family": "monospace", "figure.facecolor": "black"}):
        assert draw_once() == first
        assert matplotlib.rcParams["font.size"] == 20.0
    assert first.startswith(b"\x89PNG")
    assert b"matplotlib" not in first.lower()


def test_drawing_leaves_no_window_behind() -> None:
    loaded = "matplotlib.pyplot" in sys.modules
    draw_once()
    assert ("matplotlib.pyplot" in sys.modules) == loaded


def test_without_matplotlib_the_remedy_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    with pytest.raises(MissingPackage, match=r"pip install 'anchorpose\[experiments\]'"), canvas.default_style():
        pass


def test_a_picture_is_written_with_its_entry(tmp_path: Path) -> None:
    figure = canvas.blank_figure(1.0, 1.0)
    entry = album.write_picture(tmp_path, canvas.Picture("a.png", "What it shows.", "regions", figure))
    assert entry == {"file": "a.png", "caption": "What it shows.", "section": "regions"}
    assert (tmp_path / "a.png").read_bytes() == canvas.as_png(figure)


def test_a_small_mark_keeps_its_colour_among_many_shades() -> None:
    from matplotlib.image import imread

    figure = canvas.blank_figure(3.0, 3.0)
    axes = figure.subplots()
    axes.set_axis_off()
    axes.imshow(np.random.default_rng(4).uniform(0.3, 0.9, (60, 60, 3)), aspect="auto")
    axes.plot([30], [30], "o", color="#f0e442", markersize=4)
    pixels = imread(BytesIO(canvas.as_png(figure)))[..., :3].reshape(-1, 3)
    away = np.abs(255 * pixels - [0xF0, 0xE4, 0x42]).max(axis=1)
    assert away.min() < 16


def test_a_surface_of_no_nodes_is_an_empty_picture() -> None:
    start, node, length = no_links(0)
    empty = replace(
        flat_grid(1, 1, 0.1),
        points_m=np.zeros((0, 3), np.float32),
        normals=np.zeros((0, 3), np.float32),
        ring=np.zeros((0, 8), np.int32),
        link_start=start,
        link_node=node,
        link_length_m=length,
        camera=np.zeros(0, np.uint8),
        pixel=np.zeros((0, 2), np.int16),
        skin=np.zeros(0, np.int32),
    )
    axes = figure_axes()
    canvas.draw_mesh(axes, VIEW, empty)
    canvas.frame_axes(axes, VIEW, [(empty, 0.0)])
    assert len(axes.collections[0].get_paths()) == 0
    assert canvas.as_png(axes.figure).startswith(b"\x89PNG")
    assert canvas.apart_m(VIEW, empty, BODY) > 0


def test_pictures_are_drawn_once_and_again_where_anything_changed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    drawn, times = list[str](), PaperTimes("512 x 424", 9000, 30000, 0.002, 0.003, 0.008)

    def draw(folder: Path, plan: Plan, clip: Clip) -> None:
        drawn.append(clip.name)
        if clip is clips[1]:
            raise AnchorposeError("nobody was found")
        (folder / "a.png").write_bytes(b"picture")

    monkeypatch.setattr(album, "_show_one", draw)
    monkeypatch.setattr(album, "_paper_size_times", lambda plan, clip: times)
    clips = training_clips(replace(quick(), training_recordings=2))
    spec = PlanSpec(
        config=quick(),
        wanted=("nearest",),
        chosen=(),
        movements=tmp_path / "m.npz",
        movements_digest="m",
        cache=tmp_path / "out" / "cache",
        code=experiment_code(),
    )
    found = album.show(tmp_path / "out", spec, clips)
    assert found == (times, (f"{clips[1].name} is not shown: nobody was found",))
    assert album.show(tmp_path / "out", spec, clips) == found
    assert len(drawn) == 2
    assert (tmp_path / "out" / "pictures" / "a.png").is_file()
    for other in (replace(spec, wanted=("none",)), replace(spec, movements_digest="n"), spec):
        assert album.show(tmp_path / "out", other, clips) == found
    assert len(drawn) == 8
    (tmp_path / "out" / "pictures" / album.SHOWN).write_text("{")
    album.show(tmp_path / "out", spec, clips[:1])
    assert drawn[8:] == [clips[0].name]


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
