"""Frames in which depth is too poor for joints, interval by interval."""

from __future__ import annotations

from anchorpose.body.visibility import PoorDepth, PoorKind
from anchorpose.results.run_record import RUN_FILE, PoorInterval, RunRecord, note_poor, read_run, write_run_record


def edges(amount_m: float, camera: str = "front") -> PoorDepth:
    return PoorDepth(camera, PoorKind.EDGES, amount_m)


def intervals(*frames: tuple[PoorDepth, ...]) -> list[PoorInterval]:
    """What frames 0, 1, ... become."""
    found = list[PoorInterval]()
    for frame, poor in enumerate(frames):
        note_poor(found, frame, frame / 10.0, poor)
    assert all(one.start_s == one.first_frame / 10.0 and one.end_s == one.last_frame / 10.0 for one in found)
    return found


def ends(found: list[PoorInterval]) -> list[tuple[str, str, int, int]]:
    return [(one.camera, one.kind.value, one.first_frame, one.last_frame) for one in found]


def test_frames_in_a_row_are_one_interval_with_the_worst_of_them():
    (found,) = intervals((edges(0.090),), (edges(0.095),), (edges(0.085),))
    assert (found.first_frame, found.last_frame, found.worst) == (0, 2, 0.095)
    assert found.why == (
        "camera front: edges are drawn out over 95 mm at the patient, more than an arm is thick: "
        "joints show where the patient is, not the posture"
    )


def test_a_frame_that_resolves_limbs_ends_an_interval():
    assert ends(intervals((edges(0.09),), (), (edges(0.09),))) == [("front", "edges", 0, 0), ("front", "edges", 2, 2)]


def test_cameras_and_reasons_have_intervals_of_their_own():
    holes = PoorDepth("front", PoorKind.HOLES, 0.6)
    found = intervals((edges(0.09), edges(0.09, "side")), (holes, edges(0.09, "side")))
    assert ends(found) == [("front", "edges", 0, 0), ("side", "edges", 0, 1), ("front", "holes", 1, 1)]
    assert found[2].why.startswith("camera front: 60 % of the patient's skin towards it has no usable reading")


def test_steps_are_stated_in_millimetres():
    (found,) = intervals((PoorDepth("front", PoorKind.STEPS, 0.091),))
    assert "depth has steps of 91 mm at the patient" in found.why


def test_good_depth_has_none():
    assert intervals((), ()) == []


def test_run_json_has_the_intervals(tmp_path):
    record = RunRecord(
        recording="r", config=None, inputs_sha256={}, cameras=(), poor_depth=tuple(intervals((edges(0.09),)))
    )
    write_run_record(tmp_path / RUN_FILE, record)
    (entry,) = read_run(tmp_path / RUN_FILE)["poor_depth"]
    assert (entry["camera"], entry["kind"], entry["first_frame"], entry["worst"]) == ("front", "edges", 0, 0.09)
