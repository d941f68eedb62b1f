"""How much work a frame is, counted and not timed, so that no change doubles it unseen (``benchmarks/work.py``)."""

import sys
from pathlib import Path

import pytest

from anchorpose.simulate.config import clinic, single
from anchorpose.simulate.write import simulate_recording
from anchorpose.tracker.config import FollowConfig, TrackConfig

sys.path.insert(0, str(Path(__file__).parents[1] / "benchmarks"))

from work import work_of

FEW = TrackConfig(follow=FollowConfig(samples=2))  # looking around takes longer than all the rest
MOST = {
    "one camera": (
        single(11, seconds=1.4),
        {
            "compiled calls": 370,
            "depth images decoded": 1.1,
            "images described by the network": 0.3,
            "nodes meshed": 3_100,
            "steps of the solver": 12,
            "rows in them": 27_000,
            "poses whose probability is asked for": 1.25,
        },
    ),
    "clinic, three cameras": (
        clinic(7, seconds=1.0),
        {
            "compiled calls": 1_790,  # half of them for the first body of a therapist, in one frame of the 15
            "depth images decoded": 3.6,
            "images described by the network": 0.9,
            "nodes meshed": 10_400,
            "steps of the solver": 58,
            "rows in them": 86_000,
            "poses whose probability is asked for": 7.1,
        },
    ),
}
"""Per frame, start included: about 1.15 times what was counted when a figure was last set. The steps of the solver, the
rows and the poses were set again when each search for limbs got two more poses per limb, for limbs that are hidden."""


@pytest.mark.thorough
@pytest.mark.parametrize("title", MOST)
def test_a_frame_is_no_more_work_than_it_was(title: str, tmp_path: Path) -> None:
    config, most = MOST[title]
    simulate_recording(tmp_path / "out", config)
    done = work_of(tmp_path / "out/recording", FEW).per_frame()
    assert set(done) == set(most)
    assert {name: count for name, count in done.items() if count > most[name]} == {}
    assert all(count > 0.0 for count in done.values())
