"""Frames in which depth is too poor for joints, interval by interval."""

from anchorpose.body.visibility import PoorDepth, PoorKind
from anchorpose.results.run_record import PoorInterval, note_poor


def edges(amount_m: float, camera: str = "front") -> PoorDepth:
    return PoorDepth(camera, PoorKind.EDGES, amount_m)


def intervals(*frames: tuple[PoorDepth, ...]) -> list[PoorInterval]:
    """What frames 0, 2, 4, ... become: every second image was not tracked."""
    found, before = list[PoorInterval](), None
    for frame, poor in zip(range(0, 2 * len(frames), 2), frames, strict=True):
        note_poor(found, before, frame, frame / 10.0, poor)
        before = frame
    assert all(one.start_s == one.first_frame / 10.0 and one.end_s == one.last_frame / 10.0 for one in found)
    return found


def ends(found: list[PoorInterval]) -> list[tuple[str, str, int, int]]:
    return [(one.camera, one.kind.value, one.first_frame, one.last_frame) for one in found]


def test_frames_in_a_row_are_one_interval_with_the_worst_of_them():
    (found,) = intervals((edges(0.090),), (edges(0.095),), (edges(0.085),))
    assert (found.first_frame, found.last_frame, found.worst) == (0, 4, 0.095)
    assert found.why == (
        "camera front: edges are drawn out over 95 mm at the patient, more than an arm is thick: "
        "joints show where the patient is, not the posture"
    )


def test_a_frame_that_resolves_limbs_ends_an_interval():
    assert ends(intervals((edges(0.09),), (), (edges(0.09),))) == [("front", "edges", 0, 0), ("front", "edges", 4, 4)]


def test_cameras_and_reasons_have_intervals_of_their_own():
    holes = PoorDepth("front", PoorKind.HOLES, 0.6)
    found = intervals((edges(0.09), edges(0.09, "side")), (holes, edges(0.09, "side")))
    assert ends(found) == [("front", "edges", 0, 0), ("side", "edges", 0, 2), ("front", "holes", 2, 2)]
    assert found[2].why.startswith("camera front: 60 % of the patient's skin towards it has no usable reading")
