"""Why the patient is lost, interval by interval."""

import pytest

from anchorpose.results.run_record import LostInterval, note_lost


def intervals(*whys: str, step: int = 1) -> list[tuple[int, int, str]]:
    """First frame, last frame and reason of what frames 0, step, 2 step, ... with these reasons become."""
    found, before = list[LostInterval](), None
    for frame, why in zip(range(0, step * len(whys), step), whys, strict=True):
        note_lost(found, before, frame, frame / 10.0, why)
        before = frame
    assert all(one.start_s == one.first_frame / 10.0 and one.end_s == one.last_frame / 10.0 for one in found)
    return [(one.first_frame, one.last_frame, one.why) for one in found]


@pytest.mark.parametrize(
    ("whys", "expected"),
    [
        (("gone", "gone", "gone"), [(0, 2, "gone")]),
        (("gone", "gone", "who is it"), [(0, 1, "gone"), (2, 2, "who is it")]),
        (("gone", "", "gone"), [(0, 0, "gone"), (2, 2, "gone")]),
        (("", ""), []),
    ],
)
def test_frames_in_a_row_with_one_reason_are_one_interval(whys, expected):
    assert intervals(*whys) == expected


@pytest.mark.parametrize("step", [-1, 3])
def test_numbers_may_be_left_out_between_frames(step):
    assert intervals("gone", "gone", "", step=step) == [(0, step, "gone")]
