"""measures_by_trial.csv: a row per trial and measure, with everything that is known of the trial."""

import csv
from pathlib import Path

import numpy as np
import pytest
from results_builder import make_frame, write_results
from session_builder import RATE, squatting_joints, table

from anchorpose.exports.exporting import export_results
from anchorpose.exports.formats import Format
from anchorpose.options import ExportConfig
from anchorpose.recording.events import Trial, TrialColumn, Trials
from anchorpose.results.measuring import MeasureConfig, write_measured
from anchorpose.results.processing import ProcessingConfig
from anchorpose.results.records import read_trial_measures

TRIALS = Trials(
    (TrialColumn("amplitude", "mA", "current of the stimulator"), TrialColumn("electrodes", None)),
    (Trial(1, "off", 0.0, 3.0, 0.0, (None, "=L1")), Trial(2, "on, high", 3.5, 3.0, 3.5, (40.5, None))),
)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Results of seven seconds with two trials, exported as CSV."""
    results = tmp_path_factory.mktemp("by-trial") / "r"
    joints = table(squatting_joints(np.zeros(round(7 * RATE))))
    frames = [make_frame(k, float(joints.time_s[k]), joints.position_m[k]) for k in range(len(joints.frame))]
    write_results(results, frames)
    write_measured(results, ProcessingConfig(), MeasureConfig(), TRIALS)
    export_results(results, [Format.CSV], ExportConfig())
    return results


def rows_of(path: Path) -> list[dict[str, str]]:
    with path.open(encoding="utf-8", newline="") as stream:
        return list(csv.DictReader(stream))


def test_a_row_per_trial_and_measure_has_the_trial_s_own_numbers(folder):
    rows = rows_of(folder / "exports/csv/measures_by_trial.csv")
    measures = [row for row in read_trial_measures(folder / "measures.parquet") if row.trial is not None]
    assert len(rows) == len(measures)
    first = ["trial", "condition", "onset_s", "duration_s", "amplitude", "electrodes", "measure", "side", "part"]
    assert list(rows[0])[: len(first)] == first
    found = {(row["trial"], row["measure"], row["side"]): row for row in rows}
    knee = found["2", "knee_flexion_upright_mean", "left"]
    assert (knee["condition"], knee["onset_s"], knee["duration_s"]) == ("on, high", "3.5", "3")
    assert (knee["amplitude"], knee["electrodes"], knee["unit"]) == ("40.5", "", "deg")
    value = next(row for row in measures if row.trial == 2 and row.measure == knee["measure"] and row.side == "left")
    assert float(knee["value"]) == value.value
    assert float(knee["sigma"]) == value.sigma
    assert found["1", "knee_flexion_upright_mean", "left"]["electrodes"] == "'=L1"  # no formula for a spreadsheet
    unknown = found["1", "sway_path", ""]
    assert unknown["value"] == ""
    assert unknown["why"]


def test_the_dictionary_has_the_user_s_units_and_meanings(folder):
    rows = rows_of(folder / "exports/csv/data_dictionary.csv")
    found = {(row["file"], row["column"]): row for row in rows}
    for file in ("measures_by_trial.csv", "trials.csv"):
        assert found[file, "amplitude"]["unit"] == "mA"
        assert found[file, "amplitude"]["meaning"] == "current of the stimulator"
        assert found[file, "amplitude"]["type"] == "number"
        assert found[file, "electrodes"]["type"] == "text"
    ours = [row for row in rows if row["file"] in ("measures_by_trial.csv", "trial_intervals.csv", "trials.csv")]
    assert [row["column"] for row in ours if not row["meaning"]] == []
