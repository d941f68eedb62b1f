"""measures_by_trial.csv: a row per trial and measure, with everything that is known of the trial."""

import csv
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from ratings_builder import write_scores
from results_builder import make_frame, write_results
from session_builder import RATE, squatting_joints, table

from anchorpose.exports.exporting import export_results
from anchorpose.exports.formats import Format
from anchorpose.options import ExportConfig
from anchorpose.recording.events import Trial, TrialColumn, Trials
from anchorpose.results.measuring import MeasureConfig, write_measured
from anchorpose.results.processing import ProcessingConfig
from anchorpose.results.ratings import rated_session
from anchorpose.results.records import read_trial_measures
from anchorpose.results.run_record import read_run
from anchorpose.results.trial_table import TRIALS_FILE, read_trial_table

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
    assert {"axes.csv", "measures_by_trial.csv", "trial_intervals.csv", "trials.csv"} <= {row["file"] for row in rows}
    assert [(row["file"], row["column"]) for row in rows if not row["meaning"]] == []
    assert "axis" in found["axes.csv", "sigma_deg"]["meaning"]
    assert "does not belong to it" in found["trials.csv", "end_s"]["meaning"]  # no last frame, as of other intervals


def test_each_rater_has_a_row_per_trial_and_the_mean_is_known_where_all_have_scored(folder, tmp_path):
    results = Path(shutil.copytree(folder, tmp_path / "r"))
    session = rated_session(read_run(results / "run.json"), read_trial_table(results / TRIALS_FILE))
    write_scores(tmp_path / "r.rating_AB.tsv", "AB", [3, 8], session)
    write_scores(tmp_path / "r.rating_CD.tsv", "CD", [4, None], session)
    export_results(results, [Format.CSV], ExportConfig(), overwrite=True)
    rows = [row for row in rows_of(results / "exports/csv/measures_by_trial.csv") if row["measure"] == "blinded_rating"]
    assert [(row["person"], row["trial"], row["value"], row["unit"]) for row in rows] == [
        ("AB", "1", "3", "score"),
        ("AB", "2", "8", "score"),
        ("CD", "1", "4", "score"),
        ("CD", "2", "", "score"),
        ("", "1", "3.5", "score"),
        ("", "2", "", "score"),
    ]
    assert rows[-1]["why"] == "CD has not scored this trial"
    assert {row["condition"] for row in rows if row["trial"] == "2"} == {"on, high"}


def test_bids_has_the_trials_with_their_own_columns_and_units(folder, tmp_path):
    export_results(folder, [Format.BIDS], ExportConfig(), out=tmp_path)
    (path,) = (tmp_path / "bids").rglob("*_events.tsv")
    lines = [line.split("\t") for line in path.read_text(encoding="utf-8").splitlines()]
    assert lines[0] == [
        "onset",
        "duration",
        "trial_type",
        "trial",
        "part",
        "person",
        "state",
        "amplitude",
        "electrodes",
    ]
    trials = [dict(zip(lines[0], line, strict=True)) for line in lines[1:] if line[3] != "n/a"]
    assert [tuple(row[name] for name in ("onset", "duration", "trial_type", "trial")) for row in trials] == [
        ("0", "3", "off", "1"),
        ("3.5", "3", "on, high", "2"),
    ]
    assert [(row["amplitude"], row["electrodes"]) for row in trials] == [("n/a", "=L1"), ("40.5", "n/a")]
    others = [dict(zip(lines[0], line, strict=True)) for line in lines[1:] if line[3] == "n/a"]
    assert {row["amplitude"] for row in others} <= {"n/a"}
    assert [float(line[0]) for line in lines[1:]] == sorted(float(line[0]) for line in lines[1:])
    described = json.loads(path.with_suffix(".json").read_text(encoding="utf-8"))
    assert set(described) == set(lines[0])
    assert described["amplitude"] == {"Description": "current of the stimulator", "Units": "mA"}
    assert {row["trial_type"] for row in (*trials, *others)} <= set(described["trial_type"]["Levels"])


def test_the_bids_validator_accepts_trials(folder, tmp_path):
    places = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    validator = shutil.which("bids-validator-deno", path=places)
    if validator is None:
        pytest.skip("the BIDS validator is not installed")
    export_results(folder, [Format.BIDS], ExportConfig(), out=tmp_path)
    command = [validator, str(tmp_path / "bids"), "--format", "json"]
    answer = subprocess.run(command, capture_output=True, text=True, timeout=60)
    issues = json.loads(answer.stdout)["issues"]["issues"]
    assert [issue for issue in issues if issue["severity"] == "error"] == []
    of_events = {issue.get("subCode") for issue in issues if "events" in issue.get("location", "")}
    assert of_events <= {"StimulusPresentation"}  # software that shows stimuli on a screen; every column is described
