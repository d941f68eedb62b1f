"""Measures per trial and condition: a trial is measured as a recording of its own, a condition is its trials' mean."""

from dataclasses import replace

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from results_builder import make_frame, write_results
from session_builder import RATE, contact, measured, squatting_joints, table

from anchorpose.errors import InputError
from anchorpose.recording.events import Trial, TrialColumn, Trials
from anchorpose.results.joint_angles import joint_angles
from anchorpose.results.measuring import MeasureConfig, measure_session, write_measured
from anchorpose.results.processing import ProcessingConfig
from anchorpose.results.records import MEASURES, Measure, read_measures, read_trial_measures, write_measures
from anchorpose.results.tables import JointTable
from anchorpose.results.trial_measures import TOO_FEW_FRAMES, condition_measures, sigma_of_trial_mean, trial_intervals
from anchorpose.results.trial_table import read_intervals, read_trial_table, trial_rows, write_trials

SECONDS = 40.0


def trials_of(*spans: tuple[str, float, float]) -> Trials:
    """(condition, onset, duration) of each; the clock begins at 0."""
    rows = tuple(Trial(k, name, onset, length, onset) for k, (name, onset, length) in enumerate(spans, 1))
    return Trials((), rows)


FOUR = trials_of(("off", 0, 10), ("on", 10, 10), ("off", 20, 10), ("on", 30, 10))


def standing(knee_deg: float = 10.0, sway_m: float = 0.01) -> JointTable:
    """The patient stands throughout, with the knees bent more in every second ten seconds."""
    time_s = np.arange(round(SECONDS * RATE)) / RATE
    bent = np.where((time_s // 10) % 2 == 1, knee_deg, 2.0)
    joints = squatting_joints(bent / 2.0, bent / 2.0)
    joints[..., 0] += sway_m * np.sin(2 * np.pi * 0.4 * time_s)[:, None]
    return table(joints)


def by_trial(joints: JointTable, trials: Trials, contacts=(), **config: object) -> dict[tuple[object, ...], Measure]:
    _, rows = measure_session(joints, joint_angles(joints), contacts, MeasureConfig(**config), trials)
    found = {(row.trial or row.condition, *row.key): row for row in rows}
    assert len(found) == len(rows)  # no row is there twice
    return found


def test_the_measures_of_the_whole_recording_are_those_without_trials():
    joints = standing()
    _, whole = measured(joints)
    found = by_trial(joints, FOUR)
    assert {key[1:]: row for key, row in found.items() if key[0] is None} == whole


def test_every_measure_stands_there_for_every_trial_and_every_condition():
    found = by_trial(standing(), FOUR, (contact("knee_left", "person 1", 0, 100),))
    keys = {key[1:] for key in found if key[0] is None}
    for part in (1, 2, 3, 4, "off", "on"):
        assert {key[1:] for key in found if key[0] == part} == keys, part


@pytest.mark.parametrize("number", [1, 2, 3, 4])
def test_a_trial_is_measured_as_a_recording_of_its_own_frames(number):
    joints = standing()
    rows = trial_rows(FOUR.rows[number - 1], joints.time_s)
    _, alone = measured(joints.frames(rows))
    found = by_trial(joints, FOUR)
    for key, row in alone.items():
        same = found[(number, *key)]
        assert (same.value is None) == (row.value is None), key
        if row.value is not None:
            assert same.value == pytest.approx(row.value, rel=1e-9, abs=1e-9), key
            assert same.frames == row.frames


def test_neighbouring_trials_share_no_frame_and_lose_none():
    time_s = 0.1 + np.arange(100) / 30.0
    parts = trials_of(("a", 0.1, 1.0), ("b", 1.1, 0.9), ("c", 2.0, 1.5))
    rows = [trial_rows(trial, time_s) for trial in parts.rows]
    assert [row.start for row in rows[1:]] == [row.stop for row in rows[:-1]]
    assert rows[0].start == 0


def test_the_bent_knee_is_found_in_its_trials_only_and_the_condition_is_the_mean():
    found = by_trial(standing(knee_deg=14.0), FOUR)
    knee = [found[(trial, "knee_flexion_upright_mean", "left", None, None)] for trial in (1, 2, 3, 4)]
    off, on = (found[(name, "knee_flexion_upright_mean", "left", None, None)] for name in ("off", "on"))
    assert knee[1].value - knee[0].value == pytest.approx(12.0, abs=1.0)
    assert off.value == pytest.approx((knee[0].value + knee[2].value) / 2)
    assert on.value == pytest.approx((knee[1].value + knee[3].value) / 2)
    assert on.frames == knee[1].frames + knee[3].frames
    assert on.sigma < knee[1].sigma  # its random part is averaged, its systematic part is not
    assert on.sigma > np.sqrt(0.7) * knee[1].sigma * 0.99
    assert (off.condition, off.trial) == ("off", None)


def test_a_trial_that_begins_while_the_patient_stands_begins_upright():
    """Between the two limits posture stays what it was: alone, such a trial would not know."""
    time_s = np.arange(round(SECONDS * RATE)) / RATE
    thigh = np.where(time_s < 10.0, 0.0, 42.0)  # between 40 and 45 degrees from 10 s on
    found = by_trial(table(squatting_joints(thigh, -thigh * 0.2)), trials_of(("a", 20, 10)))
    assert found[(1, "upright_share", None, None, None)].value == pytest.approx(1.0)


def test_a_contact_counts_its_seconds_in_each_trial_and_nobody_counts_zero():
    held = contact("knee_left", "person 1", 150, 249)  # from 7.5 to 12.5 s
    found = by_trial(standing(), FOUR, (held,))
    time = [found[(trial, "assistance_time", "left", "knee_left", "person 1")] for trial in (1, 2, 3, 4)]
    assert [row.value for row in time] == pytest.approx([2.5, 2.5, 0.0, 0.0])
    assert [found[(trial, "contacts", None, None, None)].value for trial in (1, 2, 3, 4)] == [1, 1, 0, 0]
    assert time[3].sigma is None  # how many were missed is not known
    unknown = by_trial(standing(), FOUR, None)
    assert unknown[(1, "assistance_time", None, None, None)].value is None


def test_a_person_who_is_not_there_is_unknown_where_the_patient_is():
    joints = standing()
    rows = slice(400, 600)
    joints.position_m[rows], joints.sigma_m[rows], joints.state_code[rows] = np.nan, np.nan, 6
    found = by_trial(joints, FOUR, (contact("knee_left", "person 1", 150, 249),))
    row = found[(3, "assistance_time", "left", "knee_left", "person 1")]
    assert row.value is None
    assert row.why == "the patient was found in no frame"
    assert found[("off", "knee_flexion_upright_mean", "left", None, None)].value == pytest.approx(
        found[(1, "knee_flexion_upright_mean", "left", None, None)].value
    )


def test_a_trial_without_frames_has_reasons_and_no_numbers():
    found = by_trial(standing(), trials_of(("off", 0, 10), ("on", 39.96, 0.04), ("late", 50, 10)))
    for trial in (2, 3):
        rows = [row for key, row in found.items() if key[0] == trial]
        assert rows
        assert {row.why for row in rows} == {TOO_FEW_FRAMES}
    assert found[("late", "upright_time", None, None, None)].why == TOO_FEW_FRAMES


@pytest.mark.parametrize("frames", [2, 3, 7])
def test_very_short_trials_are_measured_or_refused_but_end_nothing(frames):
    found = by_trial(standing(), trials_of(("on", 5.0, frames / RATE)))
    assert found[(1, "recorded_time", None, None, None)].value == pytest.approx(frames / RATE)


def test_the_intervals_of_trials_point_at_their_rows():
    joints = standing()
    held = contact("knee_left", "person 1", 150, 249)
    session, _ = measure_session(joints, joint_angles(joints), (held,), MeasureConfig())
    found = trial_intervals(session, FOUR)
    upright = [each for each in found if each.kind == "upright"]
    assert [each.trial for each in upright] == [1, 2, 3, 4]
    assert sum(each.seconds for each in upright) == pytest.approx(SECONDS)
    touched = [each for each in found if each.table == "contacts"]
    assert [(each.trial, each.row, each.kind, each.person) for each in touched] == [
        (1, 0, "knee_left", "person 1"),
        (2, 0, "knee_left", "person 1"),
    ]
    assert [each.seconds for each in touched] == pytest.approx([2.5, 2.5])
    assert (touched[0].last_frame, touched[1].first_frame) == (199, 200)


def test_sigma_of_a_mean_over_trials_keeps_the_part_they_share():
    assert sigma_of_trial_mean([2.0], 0.7) == pytest.approx(2.0)
    assert sigma_of_trial_mean([2.0] * 4, 0.7) == pytest.approx(2.0 * np.sqrt(0.7 + 0.3 / 4))
    assert sigma_of_trial_mean([2.0, None], 0.7) is None


def test_of_trials_without_a_value_the_reasons_stay():
    rows = [
        Measure(measure="m", unit="deg", value=None, frames=0, why=why, condition="a", trial=number)
        for number, why in enumerate(("lost", "lost", "never upright"), 1)
    ]
    (row,) = condition_measures(trials_of(*[("a", 10.0 * k, 10.0) for k in range(3)]), rows)
    assert row.why == "lost; never upright"
    assert row.trial is None


WITH_UNITS = replace(
    FOUR,
    columns=(TrialColumn("amplitude", "mA", "current"), TrialColumn("electrodes", None)),
    rows=tuple(
        replace(trial, cells=(None if k == 0 else 10.0 * k, "L1" if k else None)) for k, trial in enumerate(FOUR.rows)
    ),
)


def test_trials_come_back_as_they_were_written(tmp_path):
    write_trials(tmp_path / "trials.parquet", WITH_UNITS)
    assert read_trial_table(tmp_path / "trials.parquet") == WITH_UNITS
    first = (tmp_path / "trials.parquet").read_bytes()
    write_trials(tmp_path / "trials.parquet", WITH_UNITS)
    assert (tmp_path / "trials.parquet").read_bytes() == first


def test_other_tables_are_not_taken_for_trials(tmp_path):
    path = tmp_path / "trials.parquet"
    write_measures(path, [], {})
    with pytest.raises(InputError, match="describe its columns"):
        read_trial_table(path)
    write_trials(path, WITH_UNITS)
    whole = pq.read_table(path)
    for column, values in (("duration_s", [1.0, -1.0, 1.0, 1.0]), ("trial", [1, 2, 2, 4])):
        place = whole.column_names.index(column)
        field = whole.schema.field(column)
        pq.write_table(whole.set_column(place, field, [pa.array(values, field.type)]), path)
        with pytest.raises(InputError, match="impossible"):
            read_trial_table(path)


def results_with(folder, trials: Trials | None):
    joints = standing()
    frames = [make_frame(k, float(joints.time_s[k]), joints.position_m[k]) for k in range(len(joints.frame))]
    write_results(folder, frames)
    return write_measured(folder, ProcessingConfig(), MeasureConfig(), trials)


def test_measuring_again_keeps_the_trials_and_new_ones_replace_them(tmp_path):
    folder = tmp_path / "r"
    first = results_with(folder, WITH_UNITS)
    assert {row.condition for row in first.measures} == {None}
    rows = read_trial_measures(folder / "measures.parquet")
    assert read_measures(folder / "measures.parquet") == first.measures
    assert {row.trial for row in rows} == {1, 2, 3, 4, None}
    again = write_measured(folder, ProcessingConfig(), MeasureConfig())
    assert again.trials == WITH_UNITS
    assert read_trial_measures(folder / "measures.parquet") == rows
    assert read_intervals(folder / "trial_intervals.parquet")
    write_measured(folder, ProcessingConfig(), MeasureConfig(), trials_of(("only", 0, 5)))
    assert {row.condition for row in read_trial_measures(folder / "measures.parquet")} == {"only"}


def test_a_table_of_before_there_were_trials_is_still_read(tmp_path):
    folder = tmp_path / "r"
    measures = results_with(folder, None).measures
    path = folder / "measures.parquet"
    table = pq.read_table(path)
    pq.write_table(table.drop_columns(["condition", "trial"]), path)
    assert read_measures(path) == measures
    assert read_trial_measures(path) == ()
    pq.write_table(table.drop_columns(["why"]), path)
    with pytest.raises(InputError, match="its columns are not"):
        read_measures(path)
    assert MEASURES.schema.names[-2:] == ["condition", "trial"]


def test_a_trial_without_a_condition_cannot_be():
    with pytest.raises(ValueError, match="without a condition"):
        Measure(measure="m", unit="s", value=1.0, frames=1, trial=3)
