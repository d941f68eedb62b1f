"""The experiment's work: holes, windows, true correspondence, segments, and the same answers twice."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from anchorpose.errors import AnchorposeError, InputError
from anchorpose.isolation.view import PixelLabel
from anchorpose.joints import JOINT_INDEX
from anchorpose.recording.reader import read_frame
from anchorpose.research.experiment.clips import draw_hole_frames, plan_clips, reference_joints
from anchorpose.research.experiment.config import ExperimentConfig, Form, quick
from anchorpose.research.experiment.correspondence import REGIONS
from anchorpose.research.experiment.framework import given_start
from anchorpose.research.experiment.given import GivenFrames, from_arrays, to_arrays
from anchorpose.research.experiment.matching import Window, score, take_window, truth_of
from anchorpose.research.experiment.method import NO_SUBSET, Family, Method, load_methods
from anchorpose.research.experiment.plan import Kind, Plan, PlanSpec, experiment_code, read
from anchorpose.research.experiment.results import MISSED_MM, capped_mean_mm, choose
from anchorpose.research.experiment.run import training_clips, write_movements
from anchorpose.research.experiment.work import (
    PreparedClip,
    Trial,
    open_trials,
    prepare_clip,
    segment_starts,
    track_segments,
    with_holes,
    work_on,
)
from anchorpose.surface.surface import SurfaceConfig
from anchorpose.track_tree.hypotheses import Matcher
from anchorpose.tracker.config import TrackConfig
from anchorpose.tracker.observation import Observation
from anchorpose.tracker.observing import Associate

pytestmark = pytest.mark.thorough

CONFIG = replace(quick(), seconds=1.2, segment_frames=5, methods=("nearest", "none"), windows=1)


@pytest.fixture(scope="module")
def plan(tmp_path_factory: pytest.TempPathFactory) -> Plan:
    folder = tmp_path_factory.mktemp("experiment")
    movements = folder / "movements.npz"
    write_movements(movements, training_clips(CONFIG), CONFIG.training_samples)
    return PlanSpec(
        config=CONFIG,
        wanted=CONFIG.methods,
        chosen=(),
        movements=movements,
        movements_digest="m",
        cache=folder / "cache",
        code=experiment_code(),
    ).plan()


@pytest.fixture(scope="module")
def prepared(plan: Plan) -> Iterator[PreparedClip]:
    with prepare_clip(plan_clips(CONFIG, None)[0], plan) as made:
        yield made


@pytest.fixture(scope="module")
def trials(plan: Plan, prepared: PreparedClip) -> Iterator[dict[float, Trial]]:
    with open_trials(prepared, plan, (0.0, 0.15)) as opened:
        yield opened


@pytest.fixture(scope="module")
def window(trials: dict[float, Trial]) -> Window:
    found = take_window(3, trials[0.0].given, trials[0.0].runs[Form.REFINED])
    assert found is not None
    return found


def knowing(prepared: PreparedClip, frame: int) -> Method:
    """A method that is told the truth: it bounds what any can reach, and shows that the measure knows right."""

    def associate(setting: object) -> Associate:
        def pair(now: Observation, following: Observation, config: TrackConfig) -> Matcher:
            step = int(now.frame_set.frame) - frame
            before, after = (s.surface.points_m.astype(float) for s in (now, following))
            places = prepared.skin.follow(before, frame + step, frame + step + 1, after).place_m
            apart = np.linalg.norm(np.nan_to_num(places, nan=1e3)[:, None] - after[None], axis=2)
            return Matcher(apart.argmin(axis=1).astype(np.int32)[:, None].__getitem__, len(before), NO_SUBSET)

        return pair

    return Method(key="truth", title="truth", family=Family.NONE, source="", associate=associate)


def guessing() -> Method:
    def associate(setting: object) -> Associate:
        def pair(now: Observation, following: Observation, config: TrackConfig) -> Matcher:
            match = np.random.default_rng(1).integers(0, len(following.surface), (len(now.surface), 1))
            return Matcher(match.astype(np.int32).__getitem__, len(now.surface), NO_SUBSET)

        return pair

    return Method(key="guess", title="guess", family=Family.NONE, source="", associate=associate)


def test_who_knows_the_truth_is_a_nodes_spacing_off_and_who_guesses_decimetres(
    prepared: PreparedClip, window: Window
) -> None:
    truth = truth_of(window, prepared.skin)
    known, guessed = (score(method, None, window, truth) for method in (knowing(prepared, 3), guessing()))
    assert np.nanmedian(known.direct_mm) < 12.0
    assert np.nanmean(known.tree_mm) < 15.0
    assert known.mirrored.mean() < 0.005  # where both feet touch, a node's nearest skin may be the other foot's
    assert np.nanmean(guessed.direct_mm) > 200.0
    assert 0.005 < guessed.mirrored.mean() < 0.1  # by chance, of like size: one in forty
    assert capped_mean_mm([known.tree_mm]) < 20.0 < 60.0 < capped_mean_mm([guessed.tree_mm])


def test_along_the_skin_is_never_shorter_than_straight(prepared: PreparedClip, window: Window) -> None:
    errors = score(guessing(), None, window, truth_of(window, prepared.skin))
    assert (errors.direct_skin_mm >= errors.direct_mm - 1e-3).all()
    assert np.nanmean(errors.direct_skin_mm) > 1.2 * np.nanmean(errors.direct_mm)


def test_a_frame_is_its_own_true_correspondence(prepared: PreparedClip, window: Window) -> None:
    nodes = window.observations[0].surface.points_m.astype(float)
    places = prepared.skin.follow(nodes, 3, 3, nodes)
    np.testing.assert_allclose(places.place_m[places.seen], nodes[places.seen], atol=1e-9)
    assert places.seen.mean() > 0.97


def test_distances_along_the_skin_go_round_the_body(prepared: PreparedClip) -> None:
    skin = prepared.skin
    head, left, right = (
        int(np.flatnonzero((skin.region == list(REGIONS).index(name)) & (skin.side == side))[0])
        for name, side in (("head", 0), ("hand", -1), ("hand", 1))
    )
    far = skin.along_skin_m(np.array([left, left, head]), np.array([right, left, left]))
    assert 1.2 < far[0] < 2.2
    assert far[1] == 0.0
    assert 0.7 < far[2] < 1.4


@pytest.mark.parametrize(("radius_m", "least"), [(0.03, 30), (0.06, 150), (0.15, 1)])
def test_holes_take_what_is_near_the_bodys_centre_and_nothing_else(
    prepared: PreparedClip, radius_m: float, least: int
) -> None:
    """A small hole is cut too, though the middle of the seen body lies inside it."""
    camera = prepared.recording.cameras[0]
    with with_holes(prepared, radius_m) as (holed, cut):
        np.testing.assert_array_equal(cut, prepared.in_hole)
        for frame, in_hole in enumerate(prepared.in_hole):
            before, after = (read_frame(r, frame).depths_m[0] for r in (prepared.recording, holed))
            changed = before != after
            assert (changed.sum() > least) if in_hole else not changed.any()
            if in_hole:
                assert (after[changed] == 0).all()
                points = camera.back_project(before) @ camera.require_pose()[:3, :3].T + camera.require_pose()[:3, 3]
                away = np.linalg.norm(points - prepared.reference.centre_m[frame], axis=2)
                middle = points.reshape(-1, 3)[np.argmin(np.where(before > 0, away, np.inf))]
                away = np.linalg.norm(points - middle, axis=2)
                assert away[changed].max() < radius_m
                assert (changed | (before == 0))[away < radius_m - 0.001].all()


def test_hole_frames_are_drawn_once_and_never_where_tracking_starts() -> None:
    chosen = draw_hole_frames(1000, 0.5, 3, range(0, 1000, 10))
    np.testing.assert_array_equal(chosen, draw_hole_frames(1000, 0.5, 3, range(0, 1000, 10)))
    assert not chosen[::10].any()
    assert 0.4 < chosen.mean() < 0.5
    assert (chosen != draw_hole_frames(1000, 0.5, 4, range(0, 1000, 10))).any()


def test_a_segment_is_whole_and_the_patient_is_found_in_all_of_it() -> None:
    found = np.ones(28, bool)
    found[[5, 23]] = False
    assert segment_starts(28, 5, found) == [0, 10, 15]


TWO_FORMS = [Form.REFINED, Form.MATCHES_ALL]


def test_tracking_begins_at_the_given_pose_and_leaves_its_frame_out(
    prepared: PreparedClip, plan: Plan, trials: dict[float, Trial]
) -> None:
    nearest = next(method for method in plan.methods if method.key == "nearest")
    (track,) = track_segments(nearest, None, [trials[0.0].within(TWO_FORMS)], prepared.starts, 5)
    assert track.frame.tolist() == [1, 2, 3, 4, 6, 7, 8, 9]
    error = np.linalg.norm(track.joints_m - prepared.truth_m[track.frame], axis=3)
    assert error.shape == (2, 8, 21)
    assert (error.mean(axis=(1, 2)) < 0.04).all()
    assert error[0].mean() != error[1].mean()


SLOW = pytest.mark.slow  # what is shared is shared by one function, whichever the method


@pytest.mark.parametrize("key", ["nearest", *(pytest.param(key, marks=SLOW) for key in ("next", "anchors", "fpfh"))])
def test_a_method_finds_the_same_alone_and_after_the_trials_that_it_shares_its_matches_with(
    prepared: PreparedClip, plan: Plan, trials: dict[float, Trial], key: str
) -> None:
    (method,) = load_methods((key,))
    setting = method.settings[0]
    both = [trials[hole_m].within(TWO_FORMS) for hole_m in (0.0, 0.15)]
    together = track_segments(method, setting, both, prepared.starts, 5)
    with open_trials(prepared, plan, (0.15,)) as fresh:  # nothing was seen before
        (alone,) = track_segments(method, setting, [fresh[0.15].within(TWO_FORMS)], prepared.starts, 5)
    np.testing.assert_array_equal(together[1].joints_m, alone.joints_m)
    assert (together[0].joints_m != together[1].joints_m).any()


def test_the_patients_pixels_are_given_wherever_a_method_expects_the_patient(
    prepared: PreparedClip, trials: dict[float, Trial]
) -> None:
    given, run = trials[0.0].given, trials[0.0].runs[Form.REFINED]
    start = given_start(5, given, run).observation
    astray, fresh = start.expected.moved(np.array([1.0, 0.0, 0.0])), GivenFrames(given.room, prepared.reference)
    for surface in (run.config.surface, SurfaceConfig()):
        own = replace(run, config=replace(run.config, surface=surface))
        seen = fresh.observe(fresh.frame(5), astray, 1.7, own, anchored=False)
        np.testing.assert_array_equal(seen.surface.points_m, start.surface.points_m)
    assert start.anchors.found.sum() >= 4
    assert not seen.anchors.found.any()


def test_a_hole_takes_its_nodes_and_leaves_all_other_frames_the_same(
    prepared: PreparedClip, trials: dict[float, Trial]
) -> None:
    run = trials[0.0].runs[Form.REFINED]
    for frame in range(len(prepared.in_hole)):
        (whole, holed) = (
            trial.given.observe(trial.given.frame(frame), None, 1.7, run, anchored=False) for trial in trials.values()
        )
        assert (whole.evidence is holed.evidence) != prepared.in_hole[frame]
        view, cut = whole.evidence.views[0], holed.evidence.views[0]
        gone = view.patient & ~cut.patient
        assert gone.any() == prepared.in_hole[frame]
        assert not (cut.patient & ~view.patient).any()
        assert (cut.depth_m[gone] == 0).all()
        np.testing.assert_array_equal(cut.depth_m[~gone & (cut.labels > 0)], view.depth_m[~gone & (cut.labels > 0)])


def test_a_reference_is_the_same_after_it_was_kept_as_arrays(prepared: PreparedClip) -> None:
    again = from_arrays(to_arrays(prepared.reference))
    for name in ("rotations", "joints_m", "labels", "T_world_camera"):
        np.testing.assert_array_equal(getattr(again, name), getattr(prepared.reference, name))
    assert again.clocks == prepared.reference.clocks
    short = replace(prepared.reference, shape=replace(prepared.reference.shape, missing=("left-forearm",)))
    assert from_arrays(to_arrays(short)).shape.missing == ("left-forearm",)
    assert (again.labels[0] == PixelLabel.PATIENT).any(axis=(1, 2)).all()


def test_every_answer_is_kept_and_asked_once(
    plan: Plan, prepared: PreparedClip, monkeypatch: pytest.MonkeyPatch
) -> None:
    clip = prepared.clip
    work_on(clip, plan)
    tasks = list(plan.tasks(clip))
    assert {(a.kind, a.hole_m, a.method.key) for a in tasks} == {
        (kind, hole, key) for kind in Kind for hole in (0.0, 0.15) for key in ("nearest", "none")
    }
    assert all(task.done for task in tasks)
    for task in tasks:
        arrays = read(task.path)
        if task.kind is Kind.TRACKED:
            assert arrays["error_mm"].shape == (2, 4, 21)  # two forms, one segment
            assert arrays["occluded"].any() == (task.hole_m > 0)
    monkeypatch.setattr(
        "anchorpose.research.experiment.work.simulate_recording", None
    )  # not called: nothing is left to match_window
    work_on(clip, plan)


def test_a_question_over_other_gaps_or_forms_is_another_one(plan: Plan, prepared: PreparedClip) -> None:
    def paths(kind: Kind, **changed: object) -> set[Path]:
        other = replace(plan, config=replace(plan.config, **changed))  # type: ignore[arg-type]
        return {task.path for task in other.tasks(prepared.clip) if task.kind is kind}

    assert not paths(Kind.MATCHED) & paths(Kind.MATCHED, gaps_s=(0.1, 0.3))
    assert paths(Kind.TRACKED) == paths(Kind.TRACKED, gaps_s=(0.1, 0.3))
    assert not paths(Kind.TRACKED) & paths(Kind.TRACKED, forms=tuple(Form))


def test_a_plan_made_by_another_program_is_refused(plan: Plan) -> None:
    spec = PlanSpec(
        config=CONFIG,
        wanted=(),
        chosen=(),
        movements=plan.movements,
        movements_digest="m",
        cache=plan.store.folder,
        code="another",
    )
    with pytest.raises(AnchorposeError, match="was changed while it ran"):
        spec.plan()


def test_settings_are_chosen_by_their_worth() -> None:
    tried = choose(("a", "b", "c"), (30.0, 20.0, 20.0))
    assert [t.chosen for t in tried] == [False, True, False]
    assert [t.chosen for t in choose(("a", "b"), (np.nan, 4.0))] == [False, True]
    assert [t.chosen for t in choose((None,), (np.nan,))] == [True]
    missed = np.array([np.nan, 10.0, 500.0])
    assert capped_mean_mm([missed]) == pytest.approx((MISSED_MM + 10.0 + MISSED_MM) / 3)
    assert np.isnan(capped_mean_mm([]))


def test_a_reference_skeleton_is_read_into_the_world_and_what_is_none_is_refused(tmp_path: Path) -> None:
    xyz = np.zeros((2, 2, 4))
    xyz[0, 0] = [0.1, 0.5, 2.0, 1.0]
    xyz[1, 0] = [0.1, 0.5, 2.0, 0.0]  # not sure
    np.savez(tmp_path / "skeleton.npz", names=np.array(["Head", "HandLeft"]), xyz=xyz)
    T = np.eye(4)
    T[:3, 3] = [1.0, 2.0, 3.0]
    joints = reference_joints(tmp_path / "skeleton.npz", T)
    np.testing.assert_allclose(joints[0, JOINT_INDEX["Head"]], [1.1, 1.5, 5.0])
    assert np.isfinite(joints).all(axis=2).sum() == 1
    np.savez(tmp_path / "skeleton.npz", names=np.array(["Tail"]), xyz=np.zeros((1, 1, 4)))
    with pytest.raises(InputError, match="do not fit the 21 joints"):
        reference_joints(tmp_path / "skeleton.npz", np.eye(4))
    with pytest.raises(InputError, match="there is no such file"):
        reference_joints(tmp_path / "nowhere.npz", np.eye(4))


def test_a_method_can_come_from_a_file(tmp_path: Path) -> None:
    (tmp_path / "mine.py").write_text(
        "from anchorpose.research.experiment.method import Family, Method\n"
        "METHODS = (Method(key='mine', title='mine', family=Family.LOCAL, source='me', associate=lambda s: None),)\n"
    )
    assert [m.key for m in load_methods(("fpfh", str(tmp_path / "mine.py")))] == ["fpfh", "mine"]
    with pytest.raises(InputError, match="is not a method"):
        load_methods(("fpfhh",))
    mine = (tmp_path / "mine.py").read_text()
    first = load_methods((str(tmp_path / "mine.py"),))[0].content
    (tmp_path / "mine.py").write_text(mine + "# changed")
    assert load_methods((str(tmp_path / "mine.py"),))[0].content != first
    (tmp_path / "mine.py").write_text(mine.replace("key='mine'", "key='fpfh'"))
    with pytest.raises(InputError, match="the key of two methods"):
        load_methods((str(tmp_path / "mine.py"),))
    (tmp_path / "none.py").write_text("METHODS = ()\n")
    with pytest.raises(InputError, match="does not define METHODS"):
        load_methods((str(tmp_path / "none.py"),))


@pytest.mark.parametrize(
    "wrong",
    [
        {"recordings": 0},
        {"holes_m": (0.15,)},
        {"holes_m": (0.0, 0.5)},
        {"segment_frames": 1},
        {"seconds": 0.1},
        {"training_seed": 501},
        {"hole_share": 0.0},
        {"resamples": 0},
        {"training_samples": 0},
        {"fps": 0.0},
        {"gaps_s": (0.25,)},
        {"forms": ()},
    ],
)
def test_an_experiment_that_cannot_be_made_is_refused(wrong: dict[str, object]) -> None:
    with pytest.raises(ValueError, match=r"must|are|have|should"):
        ExperimentConfig(**wrong)  # type: ignore[arg-type]


def test_a_folder_of_something_else_or_without_reference_skeletons_is_refused(tmp_path: Path) -> None:
    from anchorpose.research.experiment.run import run_experiment

    (tmp_path / "mine" / "cache").mkdir(parents=True)
    (tmp_path / "mine" / "thesis.tex").write_text("mine")
    (tmp_path / "real").mkdir()
    for out, real, sentence in (("mine", None, "is not an experiment"), ("out", tmp_path / "real", r"skeleton\.npz")):
        with pytest.raises(InputError, match=sentence):
            run_experiment(tmp_path / out, CONFIG, real, 1, lambda a, b: None, lambda text: None)
    assert sorted(path.name for path in (tmp_path / "mine").iterdir()) == ["cache", "thesis.tex"]
