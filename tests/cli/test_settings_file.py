"""One settings file for all verbs: what is in it, what has precedence, and what is refused."""

import json
import sys
from pathlib import Path

import pytest
import stand_in_pipeline
from recording_builder import write_recording
from report_builder import squats, write_session

from anchorpose.cli import app, main
from anchorpose.cli.settings_file import COMMAND_ONLY, TABLES, tracking_settings
from anchorpose.results.verify import LOG_FILE


@pytest.fixture(autouse=True)
def _stand_in_for_the_tracker(monkeypatch):
    monkeypatch.setitem(sys.modules, "anchorpose.pipeline", stand_in_pipeline)


def options_of(verb: str) -> set[str]:
    return {name for each in app[verb].assemble_argument_collection() for name in each.names}


def write(folder: Path, text: str) -> Path:
    (folder / "clinic.toml").write_text(text)
    return folder / "clinic.toml"


def config_of_run(tmp_path: Path, text: str, *options: str) -> dict[str, object]:
    recording = write_recording(tmp_path / "r", frames=5)
    command = ["track", str(recording), "-o", str(tmp_path / "out"), "--config", str(write(tmp_path, text))]
    assert main([*command, *options]) == 0
    config: dict[str, object] = json.loads((tmp_path / "out" / "run.json").read_text())["config"]
    return config


def test_the_verbs_with_a_table_are_those_with_the_option():
    verbs = {name for name in app if not name.startswith("-") and app[name].default_command}
    assert {verb for verb in verbs if "--config" in options_of(verb)} == {*TABLES, "experiment"}  # it has its own file


def test_no_table_has_the_name_of_a_setting():
    assert not set(TABLES) & {*vars(tracking_settings(None))}


def test_the_command_line_precedes_the_table_and_the_table_the_settings(tmp_path):
    text = "height_m = 1.5\nstop = 2\nsmooth = true\n[track]\nheight = 1.6\nstop = 3\n[gate]\nsearch_radius_m = 0.07\n"
    config = config_of_run(tmp_path, text, "--height", "1.7", "--smooth=false")
    assert config["height_m"] == 1.7
    assert config["stop"] == 3
    assert config["smooth"] is False
    assert config["gate"]["search_radius_m"] == 0.07


def test_a_table_of_another_verb_changes_nothing(tmp_path):
    assert config_of_run(tmp_path, "[batch]\nsmooth = true\n[live]\nheight = 1.5\n") == config_of_run(
        tmp_path / "b", ""
    )


def test_a_file_that_no_command_names_is_not_read(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "anchorpose.toml").write_text("[track]\nheight = 1.5\n")
    assert config_of_run(tmp_path, "")["height_m"] is None


def test_verbs_without_settings_of_tracking_read_their_table(tmp_path, capsys):
    results = write_session(tmp_path / "results", squats(30))
    config = write(tmp_path, 'height_m = 1.6\n[measure]\nsmooth = "butterworth"\nby = "kl"\n')
    assert main(["measure", str(results), "--config", str(config)]) == 0
    assert (results / "angles_processed.parquet").exists()
    logged = json.loads((results / LOG_FILE).read_text().splitlines()[-1])
    assert logged["by"] == "kl"
    assert main(["measure", str(results), "--config", str(config), "--smooth", "none", "--by", "ab"]) == 0
    assert not (results / "angles_processed.parquet").exists()


def test_underscores_hyphens_and_lists_are_understood(tmp_path):
    results = write_session(tmp_path / "results", squats(30))
    config = write(tmp_path, '[measure]\nsmooth = "butterworth"\nlongest_gap = 0.1\nfill = "linear"\n')
    assert main(["measure", str(results), "--config", str(config)]) == 0
    config = write(tmp_path, '[simulate]\nhole-radius = 0.1\nsensor = ["kinect-v2", "realsense"]\nseconds = 0.1\n')
    _, bound, _ = app.parse_args(["simulate", "out", "--config", str(config)], exit_on_error=False, print_error=False)
    options = bound.arguments["options"]
    assert (options.hole_radius, options.sensor) == (0.1, ("kinect-v2", "realsense"))


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("[track]\nsmoth = true", "unknown key 'track.smoth'; did you mean 'smooth'"),
        ("[track]\nzzz = 1", "unknown key 'track.zzz'; 'anchorpose track --help' lists the options"),
        ("[track]\nrecording = 'r'", "unknown key 'track.recording'"),
        ("[trak]\nsmooth = true", "unknown key 'trak'; did you mean 'track'"),
        ("[folow]\nsamples = 3", "unknown key 'folow'; did you mean 'follow'"),
        ("[follow]\nsample = 3", "unknown key 'follow.sample'; did you mean 'samples'"),
        ("zzz = 1", "unknown key 'zzz'; remove it"),
        ("track = 3", "'track' is not a table; write [track]"),
        ("[track]\nheight = 'tall'", '"tall" from'),
        ("[track]\nstart = 1.5", '"1.5" from'),
        ("[track]\nheight = 9", "[height] provided by"),
        ("[track]\nsmooth = 'always'", "always"),
        ("[track]\nheight = 1.0", "height_m is in metres"),
        ("[track", "is not TOML"),
    ],
)
def test_what_does_not_fit_is_refused_in_one_sentence_that_names_the_file(tmp_path, refusal, text, sentence):
    recording = write_recording(tmp_path / "r", frames=2)
    config = write(tmp_path, text)
    said = refusal(["track", str(recording), "-o", str(tmp_path / "out"), "--config", str(config)])
    assert sentence in said
    assert said.count("\n") == 1
    assert "height_m is" in said or "clinic.toml" in said
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("option", sorted(COMMAND_ONLY))
def test_a_file_does_not_decide_what_is_written_or_replaced(tmp_path, refusal, option):
    recording = write_recording(tmp_path / "r", frames=2)
    config = write(tmp_path, f"[track]\n{option} = true\n")
    said = refusal(["track", str(recording), "-o", str(tmp_path / "out"), "--config", str(config)])
    assert f"'track.{option}' cannot stand in a file; give --{option} in the command" in said


def test_a_mistake_in_the_settings_of_tracking_is_refused_by_every_verb(tmp_path, refusal):
    results = write_session(tmp_path / "results", squats(30))
    said = refusal(["measure", str(results), "--config", str(write(tmp_path, "height_m = 'tall'\n"))])
    assert "height_m" in said
    assert not (results / LOG_FILE).exists()
