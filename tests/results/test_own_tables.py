"""Tables that belong to another folder, or hold nothing, are refused by every verb that reads them."""

import json
import shutil
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from places_builder import make_places
from recording_builder import edit_json
from report_builder import squats, write_session

from anchorpose.cli import main
from anchorpose.errors import InputError
from anchorpose.results.run_record import RUN_FILE, hash_files
from anchorpose.results.verify import require_own

VERBS = {
    "measure": ["measure", "{results}"],
    "export": ["export", "{results}", "--to", "csv", "-o", "{out}"],
    "report": ["report", "{results}"],
    "view": ["view", "{results}", "--no-browser"],
    "evaluate --truth": ["evaluate", "{results}", "--truth", "{truth}"],
    "evaluate --reference": ["evaluate", "{results}", "--reference", "{lab}"],
    "reliability": ["reliability", "{sessions}"],
    "motions build": ["motions", "build", "{out}.npz", "{results}"],
}


@pytest.fixture
def given(tmp_path) -> dict[str, Path]:
    (tmp_path / "lab.csv").write_text("time_s,HeadX_x_m,Head_x_m,Head_y_m,Head_z_m\n0,0,0,0,0\n1,0,0,0,1\n")
    (tmp_path / "sessions.csv").write_text("subject,session,results\np1,1,results\n")
    return make_places(tmp_path) | {"lab": tmp_path / "lab.csv", "sessions": tmp_path / "sessions.csv"}


@pytest.mark.parametrize("verb", VERBS)
def test_joints_of_another_recording_are_refused(given, verb, capsys):
    shutil.copyfile(given["later"] / "joints.parquet", given["results"] / "joints.parquet")
    before = {path: path.read_bytes() for path in given["results"].iterdir() if path.is_file()}
    assert main([each.format(**given) for each in VERBS[verb]]) == 2
    assert "joints.parquet: is not the table that was written into this folder" in capsys.readouterr().err
    assert {path: path.read_bytes() for path in given["results"].iterdir() if path.is_file()} == before


@pytest.mark.parametrize("verb", ["report", "reliability"])
def test_measures_of_another_recording_are_refused_until_they_are_measured_again(given, verb, refusal):
    shutil.copyfile(given["later"] / "angles.parquet", given["results"] / "measures.parquet")
    arguments = [each.format(**given) for each in VERBS[verb]]
    assert "measures.parquet: is not the table" in refusal(arguments)
    assert main(["measure", str(given["results"])]) == 0
    assert main(arguments) == 0


def test_a_folder_whose_hashes_nobody_knows_is_accepted_and_a_run_json_that_cannot_be_read_refused(given):
    run = json.loads((given["results"] / RUN_FILE).read_text())
    (given["results"] / RUN_FILE).write_text(json.dumps(run | {"outputs_sha256": {}}))
    (given["results"] / "log.jsonl").unlink()
    require_own(given["results"], ("joints.parquet", "measures.parquet"))
    (given["results"] / RUN_FILE).unlink()
    require_own(given["results"], ("joints.parquet", "measures.parquet"))
    (given["results"] / RUN_FILE).write_text("{}")
    with pytest.raises(InputError, match=r"is not a run\.json"):
        require_own(given["results"], ("joints.parquet",))


@pytest.mark.parametrize("table", ["joints", "angles", "posture", "measures"])
def test_a_table_without_rows_is_refused_as_one(given, table, refusal):
    """By a folder of which no hash is known, so that the table itself is read."""
    run = json.loads((given["results"] / RUN_FILE).read_text())
    (given["results"] / RUN_FILE).write_text(json.dumps(run | {"outputs_sha256": {}}))
    (given["results"] / "log.jsonl").unlink()
    path = given["results"] / f"{table}.parquet"
    whole = pq.read_table(path)
    pq.write_table(whole.slice(0, 0), path, write_page_checksum=True)
    for verb in VERBS if table == "joints" else ["report"]:
        if verb != "reliability":
            assert f"{table}.parquet: has no rows; " in refusal([each.format(**given) for each in VERBS[verb]])


def test_a_value_that_was_changed_after_tracking_is_refused(tmp_path, refusal):
    """Measures that 'anchorpose track' wrote, so that run.json alone has their hash."""
    folder = write_session(tmp_path / "r", squats(20))
    edit_json(folder / RUN_FILE, lambda run: run.update(outputs_sha256=hashes_of(folder)))
    path = folder / "measures.parquet"
    whole = pq.read_table(path)
    more = pa.array([None if value is None else 1.5 * value for value in whole["value"].to_pylist()], pa.float64())
    changed = whole.set_column(whole.schema.get_field_index("value"), "value", more)
    pq.write_table(changed.cast(whole.schema), path, write_page_checksum=True)
    for verb in (["report", str(folder)], ["export", str(folder), "--to", "csv"]):
        assert "measures.parquet: is not the table" in refusal(verb)


def hashes_of(folder: Path) -> dict[str, str]:
    return dict(hash_files(sorted(folder.glob("*.parquet")), folder))


def spoil(folder: Path, table: str, column: str, change) -> None:
    """Change a column of a table as its hash in run.json says."""
    path = folder / table
    whole = pq.read_table(path)
    values = pa.array(change(whole[column].to_numpy(zero_copy_only=False)), whole.schema.field(column).type)
    free = pa.schema([field.with_nullable(True) for field in whole.schema], whole.schema.metadata)
    changed = whole.cast(free).set_column(whole.schema.get_field_index(column), free.field(column), values)
    pq.write_table(changed, path, write_page_checksum=True)
    edit_json(folder / RUN_FILE, lambda run: run.update(outputs_sha256=hashes_of(folder)))
    (folder / "log.jsonl").unlink(missing_ok=True)


SPOILT = {
    "millimetres": ("x_m", lambda v: 1000.0 * (v + 1.0)),
    "nowhere": ("x_m", lambda v: v + np.inf),
    "overflow": ("x_m", lambda v: v + 1e38),
    "missing": ("x_m", lambda v: [None] * len(v)),
    "negative sigma": ("sigma_m", lambda v: -v),
    "sigma of zero": ("sigma_m", lambda v: 0.0 * v),
    "endless sigma": ("sigma_m", lambda v: v + np.inf),
    "no state": ("state", lambda v: [None] * len(v)),
    "unknown state": ("state", lambda v: ["seen"] * len(v)),
    "milliseconds": ("time_s", lambda v: 1e6 * v),
    "nanoseconds": ("time_s", lambda v: 1e9 * v),
    "farthest": ("time_s", lambda v: 1e12 * v),
    "one time": ("time_s", lambda v: 0.0 * v),
    "backwards": ("time_s", lambda v: -v),
    "no times": ("time_s", lambda v: v * np.nan),
    "null times": ("time_s", lambda v: [None] * len(v)),
    "negative frames": ("frame", lambda v: v - 1),
    "one frame": ("frame", lambda v: 0 * v),
}


@pytest.mark.parametrize("fault", SPOILT)
def test_joints_that_cannot_be_are_refused_before_anything_is_written(given, fault, refusal):
    spoil(given["results"], "joints.parquet", *SPOILT[fault])
    before = {path: path.read_bytes() for path in given["results"].iterdir() if path.is_file()}
    for verb in VERBS:
        if verb != "reliability":  # which reads measures only
            assert "joints.parquet: " in refusal([each.format(**given) for each in VERBS[verb]]), verb
    assert {path: path.read_bytes() for path in given["results"].iterdir() if path.is_file()} == before


@pytest.mark.parametrize(
    ("table", "column", "change"),
    [
        ("angles.parquet", "degrees", lambda v: v + 1e6),
        ("angles.parquet", "sigma_deg", lambda v: -1.0 - v),
        ("posture.parquet", "com_x_m", lambda v: v + np.inf),
        ("measures.parquet", "frames", lambda v: -1 - v),
        ("measures.parquet", "sigma", lambda v: -1.0 - v),
        ("measures.parquet", "unit", lambda v: [None] * len(v)),
        ("measures.parquet", "value", lambda v: [None] * len(v)),
    ],
)
def test_other_values_that_cannot_be_are_refused(given, table, column, change, refusal):
    spoil(given["results"], table, column, change)
    assert f"{table}: " in refusal(["report", str(given["results"])])


@pytest.mark.parametrize("file", ["joints.parquet", "pictures/a.png"])
def test_a_file_of_four_terabytes_is_not_read(given, file, capsys, refusal):
    path = given["results"] / file
    path.parent.mkdir(exist_ok=True)
    with path.open("ab") as grown:
        grown.truncate(1 << 42)  # sparse
    for verb in VERBS if file == "joints.parquet" else ():
        assert main([each.format(**given) for each in VERBS[verb]]) == 2, verb
        assert "joints.parquet: has 4,398,046,511,104 bytes" in capsys.readouterr().err, verb
    assert f"{path.name}: has 4,398,046,511,104 bytes" in refusal(["verify", str(given["results"])])
