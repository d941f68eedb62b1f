"""The command line: helpful, quick to answer, and clean when it stops."""

import json
import os
import re
import sys
import time

import numpy as np
import pytest
import stand_in_pipeline
from cyclopts import App
from recording_builder import write_recording
from results_builder import make_frame, standing_joints, write_results

from anchorpose.cli import GROUPS, STOPPING, main
from anchorpose.joints import JOINT_NAMES

NAMES = "demo simulate check calibrate track evaluate measure report inspect motions verify benchmark"
VERBS = tuple(NAMES.split())


@pytest.fixture(autouse=True)
def _stand_in_for_the_tracker(monkeypatch):
    monkeypatch.setitem(sys.modules, "anchorpose.pipeline", stand_in_pipeline)


@pytest.mark.parametrize("verb", VERBS)
def test_every_verb_explains_itself(verb, capsys):
    assert main([verb, "--help"]) == 0
    text = capsys.readouterr().out
    assert f"anchorpose {verb}" in text
    assert len(text) > 300


def test_tracking_writes_the_results_and_says_where(tmp_path, capsys):
    recording = write_recording(tmp_path / "r", frames=3)
    assert main(["track", str(recording), "-o", str(tmp_path / "out")]) == 0
    measured = {f"{table}.parquet" for table in ("angles", "axes", "posture", "episodes", "measures")}
    written = {"joints.parquet", "contacts.parquet", "run.json", "report.html"}
    assert {path.name for path in (tmp_path / "out").iterdir()} == written | measured
    assert "3 frames" in capsys.readouterr().out
    assert {path.name for path in tmp_path.iterdir()} == {"r", "out"}


def test_options_reach_the_tracker_on_top_of_the_file(tmp_path):
    recording = write_recording(tmp_path / "r", frames=5)
    (tmp_path / "c.toml").write_text("start = 2\n[gate]\nsearch_radius_m = 0.07\n")
    command = ["track", str(recording), "-o", str(tmp_path / "out"), "--config", str(tmp_path / "c.toml")]
    assert main([*command, "--patient", "-0.5,1.25@3", "--height", "1.72", "--stop", "4"]) == 0
    config = json.loads((tmp_path / "out" / "run.json").read_text())["config"]
    assert config["gate"]["search_radius_m"] == 0.07
    assert (config["patient_xz_m"], config["patient_frame"]) == ([-0.5, 1.25], 3)
    assert (config["start"], config["stop"]) == (2, 4)
    assert config["height_m"] == 1.72


def test_an_interrupt_leaves_nothing_and_exits_with_130(tmp_path, monkeypatch, capsys):
    recording = write_recording(tmp_path / "r", frames=3)

    def interrupted(path, results, config, progress, calibration, corrections, threads, events):
        (results / "joints.parquet").write_bytes(b"half")
        raise KeyboardInterrupt

    monkeypatch.setattr(stand_in_pipeline, "track_recording", interrupted)
    assert main(["track", str(recording), "-o", str(tmp_path / "out")]) == 130
    assert {path.name for path in tmp_path.iterdir()} == {"r"}
    assert "Nothing was written" in capsys.readouterr().err


@pytest.mark.parametrize(("number", "code"), [(int(number), 128 + number) for number in STOPPING])
def test_a_signal_leaves_nothing_or_says_how_to_go_on(tmp_path, monkeypatch, capsys, number, code):
    recording = write_recording(tmp_path / "r", frames=3)

    def stopped(path, results, config, progress, calibration, corrections, threads, events):
        (results / "journal").mkdir()
        (results / "journal" / "begun.json").write_text('{"identity": "1"}')
        (results / "journal" / "learnt").write_bytes(b"1")
        try:
            os.kill(os.getpid(), number)
            time.sleep(1.0)
        except KeyboardInterrupt as error:
            raise SystemError("a kernel returned a result with an exception set") from error

    monkeypatch.setattr(stand_in_pipeline, "track_recording", stopped)
    assert main(["track", str(recording), "-o", str(tmp_path / "out")]) == code
    assert capsys.readouterr().err.endswith("Stopped. What was done is kept: the same command with --resume goes on.\n")
    assert {path.name for path in tmp_path.iterdir()} == {"r", ".out.unfinished"}


def test_evaluate_prints_the_figures_and_writes_them(tmp_path, capsys):
    results = write_results(tmp_path / "out", [make_frame(i, i / 10, standing_joints() + 0.01) for i in range(3)])
    truth = np.stack([standing_joints()] * 3)
    np.savez(tmp_path / "truth.npz", joints=truth, names=np.array(JOINT_NAMES), time=np.arange(3) / 10)
    command = ["evaluate", str(results), "--truth", str(tmp_path / "truth.npz"), "--json", str(tmp_path / "e.json")]
    assert main(command) == 0
    assert "17.3" in capsys.readouterr().out  # sqrt(3) x 10 mm
    assert json.loads((tmp_path / "e.json").read_text())["mean_mm"] == pytest.approx(10 * np.sqrt(3))


@pytest.mark.parametrize(
    ("command", "sentence"),
    [
        (["track", "somewhere", "-o", "out", "--patient", "here"], "--patient is 'here'"),
        (["track", "somewhere", "-o", "out", "--patient", "1,2,3"], "two numbers"),
        (["track", "somewhere", "-o", "out", "--patient", "nan,1"], "two numbers"),
        (["track", "somewhere", "-o", "out", "--patient", "0.1,1@soon"], "the number of a frame"),
        (["track", "somewhere", "-o", "out", "--start", "-1"], "--start"),
        (["track", "somewhere"], "--output"),
        (["trak"], 'Did you mean "track"'),
        (["simulate", "out", "--preset", "ward"], "clinic"),
        (["simulate", "out", "--motions", "flying"], "motion"),
        (["simulate", "out", "--cameras", "9"], "cameras"),
        (["simulate", "out", "--preset", "rehabilitation"], "give their file with --movements"),
        (["simulate", "out", "--preset", "rehabilitation", "--movements", "m.npz"], "m.npz: there is no such file"),
        (["simulate", "out", "--movements", "m.npz"], "add --preset rehabilitation"),
        (["simulate", "out", "--equipment", "walker", "--scene", "leaves"], "walk out"),
        (["simulate", "out", "--preset", "room", "--sensor", "kinect-v1"], "another seed"),
        (["simulate", "out", "--preset", "room", "--scene", "hidden"], "another seed"),
        (["simulate", "out", "--trials", "4"], "add --preset stimulation"),
        (["simulate", "out", "--preset", "stimulation", "--seconds", "5"], "lasts as long as its trials"),
        (["simulate", "out", "--hole-radius", "0.15"], "add --preset holes"),
        (["simulate", "out", "--preset", "stimulation", "--speed", "slow"], "leave it out"),
        (["simulate", "out", "--preset", "single", "--scene", "leaves", "--seconds", "6"], "a longer recording"),
        (["simulate", "out", "--preset", "stimulation", "--trials", "7"], "multiple of 2"),
        (["simulate", "out", "--preset", "stimulation", "--trials", "2"], "ask for fewer"),
        (["simulate", "out", "--preset", "stimulation", "--equipment", "walker"], "parallel bars"),
        (["simulate", "out", "--preset", "room", "--movements", "m.npz"], "m.npz"),
        (["evaluate", "out", "--truth", "t.npz"], "joints.parquet"),
        (["report", "out"], "run.json"),
        (["evaluate", "out", "--truth", "t.npz", "--skip-s", "-1"], "--skip-s"),
        (["evaluate", "out", "--reference", "a.trc", "--json", "e.json"], "--json belongs to --truth; leave it out"),
        (["evaluate", "out", "--labels", "l.csv", "--skip-s", "2"], "--skip-s belongs to --truth; leave it out"),
        (["evaluate", "out", "--truth", "t.npz", "-o", "a"], "--output belongs to --reference; leave it out"),
        (["evaluate", "out", "--truth", "t.npz", "--overwrite"], "--overwrite belongs to --reference; leave it out"),
        (["evaluate", "out", "--reference", "a.trc", "--overwrite"], "--overwrite belongs to --output; leave it out"),
        (["evaluate", "out", "--labels", "l.csv", "--subject", "a"], "--subject belongs to --reference; leave it out"),
        (["evaluate", "out", "--truth", "t.npz", "--hip", "functional"], "--hip belongs to --reference; leave it out"),
        (
            ["evaluate", "out", "--labels", "l.csv", "--recording", "r", "--exchange-sides"],
            "--exchange-sides belongs to --reference; leave it out",
        ),
        (["evaluate", "out", "--reference", "a.trc", "--recording", "r"], "--recording belongs to --labels; leave it"),
    ],
)
def test_what_makes_no_sense_is_refused_with_a_remedy(tmp_path, monkeypatch, refusal, command, sentence):
    monkeypatch.chdir(tmp_path)
    assert sentence in " ".join(refusal(command).replace("│", " ").split())
    assert list(tmp_path.iterdir()) == []


def test_help_names_every_verb_once_in_a_group(capsys):
    assert main(["--help"]) == 0
    page = capsys.readouterr().out
    places = [page.index(f"─ {title} ") for title in GROUPS]
    assert places == sorted(places)
    names = [_name_of(verb) for verbs in GROUPS.values() for verb in verbs]
    assert len({*names}) == len(names)
    assert all(len(re.findall(rf"^│ {name} ", page, re.MULTILINE)) == 1 for name in names)


def _name_of(verb):
    return verb.name[0] if isinstance(verb, App) else verb.__name__


def test_a_shell_can_complete_verbs_and_options(tmp_path):
    script = tmp_path / "completion.bash"
    assert main(["--install-completion", "--shell", "bash", "--output", str(script)]) == 0
    written = script.read_text(encoding="utf-8")
    assert all(word in written for word in ("calibrate", "reliability", "--smooth"))
