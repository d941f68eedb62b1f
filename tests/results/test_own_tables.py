"""Tables that belong to another folder, or hold nothing, are refused by every verb that reads them."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from results_builder import make_frame, standing_joints, write_results

from anchorpose.cli import main
from anchorpose.errors import InputError
from anchorpose.joints import JOINT_NAMES
from anchorpose.results.run_record import RUN_FILE
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
    for name, height_m in (("results", 0.0), ("others", 0.2)):
        joints = standing_joints() + np.array([0.0, height_m, 0.0])
        write_results(tmp_path / name, [make_frame(k, k / 15, joints) for k in range(40)])
        assert main(["measure", str(tmp_path / name)]) == 0
    arrays = {"joints": np.repeat(standing_joints()[None], 40, 0), "names": np.array(JOINT_NAMES)}
    np.savez(tmp_path / "truth.npz", **arrays, time=np.arange(40) / 15)
    (tmp_path / "lab.csv").write_text("time_s,HeadX_x_m,Head_x_m,Head_y_m,Head_z_m\n0,0,0,0,0\n1,0,0,0,1\n")
    lines = ["subject,session,results", *(f"p{s},{k},results" for s in range(3) for k in range(2))]
    (tmp_path / "sessions.csv").write_text("\n".join(lines) + "\n")
    files = {"truth": "truth.npz", "lab": "lab.csv", "sessions": "sessions.csv"}
    return {name: tmp_path / files.get(name, name) for name in ("results", "others", "out", *files)}


@pytest.mark.parametrize("verb", VERBS)
def test_joints_of_another_recording_are_refused(given, verb, capsys):
    shutil.copyfile(given["others"] / "joints.parquet", given["results"] / "joints.parquet")
    before = {path: path.read_bytes() for path in given["results"].iterdir() if path.is_file()}
    assert main([each.format(**given) for each in VERBS[verb]]) == 2
    assert "joints.parquet: is not the table that was written into this folder" in capsys.readouterr().err
    assert {path: path.read_bytes() for path in given["results"].iterdir() if path.is_file()} == before


@pytest.mark.parametrize("verb", ["report", "reliability"])
def test_measures_of_another_recording_are_refused_until_they_are_measured_again(given, verb, capsys):
    shutil.copyfile(given["others"] / "angles.parquet", given["results"] / "measures.parquet")
    arguments = [each.format(**given) for each in VERBS[verb]]
    assert main(arguments) == 2
    assert "measures.parquet: is not the table" in capsys.readouterr().err
    assert main(["measure", str(given["results"])]) == 0
    assert main(arguments) == 0


def test_a_folder_whose_hashes_nobody_knows_is_accepted(given):
    run = json.loads((given["results"] / RUN_FILE).read_text())
    (given["results"] / RUN_FILE).write_text(json.dumps(run | {"outputs_sha256": {}}))
    (given["results"] / "log.jsonl").unlink()
    require_own(given["results"], ("joints.parquet", "measures.parquet"))
    (given["results"] / RUN_FILE).unlink()
    require_own(given["results"], ("joints.parquet", "measures.parquet"))


def test_a_run_json_that_cannot_be_read_is_refused(given):
    (given["results"] / RUN_FILE).write_text("{}")
    with pytest.raises(InputError, match=r"is not a run\.json"):
        require_own(given["results"], ("joints.parquet",))


@pytest.mark.parametrize("table", ["joints", "angles", "posture", "measures"])
def test_a_table_without_rows_is_refused_as_one(given, table, capsys):
    """By a folder of which no hash is known, so that the table itself is read."""
    run = json.loads((given["results"] / RUN_FILE).read_text())
    (given["results"] / RUN_FILE).write_text(json.dumps(run | {"outputs_sha256": {}}))
    (given["results"] / "log.jsonl").unlink()
    path = given["results"] / f"{table}.parquet"
    whole = pq.read_table(path)
    pq.write_table(whole.slice(0, 0), path, write_page_checksum=True)
    for verb in VERBS if table == "joints" else ["report"]:
        if verb != "reliability":
            assert main([each.format(**given) for each in VERBS[verb]]) == 2, verb
            assert f"{table}.parquet: has no rows; " in capsys.readouterr().err
