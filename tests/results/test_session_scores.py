"""A result of a session against its truth: values worked out by hand, and refusal of what does not fit."""

from dataclasses import replace

import numpy as np
import pytest
from event_builder import HZ, buckling, tracked
from session_builder import measured

from anchorpose.body.contact_regions import REGIONS
from anchorpose.errors import InputError
from anchorpose.results.records import Measure
from anchorpose.results.session_scores import (
    EventScore,
    TimeScore,
    TrueEvent,
    read_true_contacts,
    read_true_events,
    score_events,
    score_times,
)


def test_events_are_found_late_missed_on_the_wrong_side_or_false():
    session = measured(tracked(buckling(30.0, [5.0, 12.0, 20.0], 35.0, 0.3), 0.001, 1))[0]
    truth = [
        TrueEvent("knee_buckle_left", 5.0, 5.3, 35.0),
        TrueEvent("knee_buckle_left", 12.0 - 0.3, 12.0, 35.0),  # found, but not in time
        TrueEvent("knee_buckle_right", 20.0, 20.3, 35.0),  # found on the other side
        TrueEvent("knee_buckle_right", 29.9, 30.2, 35.0),  # not recorded to its end
        TrueEvent("clonus_left", 3.0, 6.0, 2.0),  # no event of the results
    ]
    found = dict(score_events(session, truth))
    left = found["knee_buckle_left"]
    assert replace(left, late_s=None) == EventScore(true=2, found=2, in_time=1, false=1, late_s=None)
    assert left.late_s == pytest.approx(0.15, abs=2.0 / HZ)
    assert found["knee_buckle_right"] == EventScore(true=1, found=0, in_time=0, false=0, late_s=None)
    assert set(found) == {"knee_buckle_left", "knee_buckle_right"}


def test_one_event_is_not_found_twice():
    session = measured(tracked(buckling(12.0, [5.0], 35.0, 0.3), 0.001, 1))[0]
    truth = [TrueEvent("knee_buckle_left", 5.0 + late_s, 5.3 + late_s, 35.0) for late_s in (0.0, 0.2)]
    assert dict(score_events(session, truth))["knee_buckle_left"].found == 1


def row(value: float | None, sigma: float | None = 1.0, **more: object) -> Measure:
    like = {"measure": "knee_extended_alone_time", "unit": "s", "frames": 9}
    return Measure(**like | {"value": value, "sigma": sigma, "why": "unknown" if value is None else None} | more)


def test_frames_too_far_apart_have_no_events_to_compare():
    sparse = tracked(buckling(12.0, [5.0], 35.0, 0.3), 0.001, 1).frames(slice(None, None, 4))
    assert score_events(measured(sparse)[0], [TrueEvent("knee_buckle_left", 5.0, 5.3, 35.0)]) == ()


def test_times_are_within_outside_refused_or_not_compared():
    trials = [{"condition": "on", "trial": number} for number in range(1, 7)]
    pairs = [
        (row(10.0, **trials[0]), row(11.9, **trials[0])),  # within 1.96 sigma
        (row(10.0, **trials[1]), row(12.0, **trials[1])),  # outside
        (row(0.0, **trials[2]), row(0.0, **trials[2])),  # nothing to compare
        (row(None, None, **trials[3]), row(3.0, **trials[3])),  # refused
        (row(5.0, None, **trials[4]), row(5.0, **trials[4])),  # exact without a sigma
        (row(9.0, condition="on"), row(1.0, condition="on")),  # a mean of trials that are compared already
        (row(9.0, measure="upright_time"), row(1.0, measure="upright_time")),  # no time of independence
        (row(9.0, unit="count", sigma=None), row(1.0, unit="count", sigma=None)),
    ]
    found, true = zip(*pairs, strict=True)
    assert score_times(found, true) == TimeScore(compared=3, within=2, refused=1)


def write_truth(path, **changed):
    touched = np.zeros((6, 2, len(REGIONS)), dtype=bool)
    touched[1:3, 0, REGIONS.index("knee_left")] = touched[3:5, 1, REGIONS.index("knee_left")] = True
    on_equipment = np.zeros((6, 1, 3), dtype=bool)
    on_equipment[2:, 0] = True
    arrays = {
        "time": np.arange(6) / 10,
        "touched_regions": touched,
        "region_names": np.array(REGIONS),
        "on_equipment": on_equipment,
        "equipment_names": np.array(["rail-left"]),
        "part_names": np.array(["LeftHand", "LeftFoot", "LThumb"]),
        "event_kind": np.array(["clonus_left"]),
        **{f"event_{name}": np.array([1.0]) for name in ("start_s", "end_s", "depth")},
    }
    np.savez(path, **(arrays | changed))
    return path


def test_true_contacts_are_those_of_any_person_and_no_foot_on_the_floor(tmp_path):
    path = write_truth(tmp_path / "truth.npz")
    rows = np.arange(1, 6)  # the result begins a frame later, and numbers its frames from 100
    (people, equipment), parts = read_true_contacts(path, rows, 100 + rows, rows / 10)
    assert (people.part, people.person is None, people.first_frame, people.last_frame) == ("knee_left", False, 101, 104)
    assert (equipment.part, equipment.with_, equipment.first_frame) == ("hand_left", "rail-left", 102)
    assert parts == ("rail-left",)
    assert read_true_events(path) == (TrueEvent("clonus_left", 1.0, 1.0, 1.0),)


def test_a_truth_whose_arrays_do_not_fit_is_refused_and_one_without_a_session_has_none(tmp_path):
    path = write_truth(tmp_path / "truth.npz", event_depth=np.zeros(2))
    with pytest.raises(InputError, match="do not fit"):
        read_true_events(path)
    path, frames = write_truth(tmp_path / "truth.npz", on_equipment=np.zeros((6, 2, 3), bool)), np.arange(6)
    with pytest.raises(InputError, match="do not fit"):
        read_true_contacts(path, frames, frames, frames / 10)
    np.savez(tmp_path / "truth.npz", time=np.arange(6) / 10)
    assert read_true_events(tmp_path / "truth.npz") is None
    with pytest.raises(InputError, match="lacks touched_regions"):
        read_true_contacts(tmp_path / "truth.npz", frames, frames, frames / 10)
