"""No input may be a pipe or a device: each option of each verb that reads a file refuses both, by name, at once."""

import os
import shutil
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from places_builder import make_places
from results_builder import standing_joints

from anchorpose.cli import app, main
from anchorpose.joints import JOINT_NAMES

resource = pytest.importorskip("resource", reason="limits of a process exist on POSIX only")

MOST_S, MOST_BYTES = 20, 4 << 30

BY_GYROSCOPE = ("--segment", "trunk", "--gyroscope", "Head_x_m")
BY_PULSES = ("--pulses", "Head_x_m", "--pulse-times")

READS = {
    "simulate --movements": ["simulate", "{out}", "--preset", "rehabilitation", "--movements", "{x}"],
    "simulate --body": ["simulate", "{out}", "--body", "{x}"],
    "simulate --config": ["simulate", "{out}", "--config", "{x}.toml"],
    "convert --config": ["convert", "{recording}", "{out}", "--config", "{x}.toml"],
    "convert PATHS": ["convert", "{x}", "{out}"],
    "check RECORDING": ["check", "{x}"],
    "calibrate RECORDING": ["calibrate", "{x}", "-o", "{out}"],
    "calibrate --markers": ["calibrate", "{recording}", "-o", "{out}", "--markers", "{x}"],
    "calibrate --config": ["calibrate", "{recording}", "-o", "{out}", "--config", "{x}.toml"],
    "track RECORDING": ["track", "{x}", "-o", "{out}"],
    "track --calibration": ["track", "{recording}", "-o", "{out}", "--calibration", "{x}"],
    "track --corrections": ["track", "{recording}", "-o", "{out}", "--corrections", "{x}"],
    "track --events": ["track", "{recording}", "-o", "{out}", "--events", "{x}"],
    "track --motions": ["track", "{recording}", "-o", "{out}", "--motions", "{x}"],
    "track --config": ["track", "{recording}", "-o", "{out}", "--config", "{x}.toml"],
    "evaluate RESULTS": ["evaluate", "{x}", "--truth", "{truth}"],
    "evaluate OTHERS": ["evaluate", "{results}", "{x}", "--reference", "{trc}", "--reference", "{trc}"],
    "evaluate --truth": ["evaluate", "{results}", "--truth", "{x}"],
    "evaluate --reference": ["evaluate", "{results}", "--reference", "{x}.csv"],
    "evaluate --reference TRC": ["evaluate", "{results}", "--reference", "{x}.trc"],
    "evaluate --reference C3D": ["evaluate", "{results}", "--reference", "{x}.c3d"],
    "evaluate --reference MOT": ["evaluate", "{results}", "--reference", "{x}.mot"],
    "evaluate --names": ["evaluate", "{results}", "--reference", "{trc}", "--names", "{x}"],
    "evaluate --transform": ["evaluate", "{results}", "--reference", "{trc}", "--transform", "{x}"],
    "evaluate --labels": ["evaluate", "{results}", "--labels", "{x}", "--recording", "{recording}"],
    "evaluate --recording": ["evaluate", "{results}", "--labels", "{labels}", "--recording", "{x}"],
    "evaluate --config": ["evaluate", "{results}", "--truth", "{truth}", "--config", "{x}.toml"],
    "measure RESULTS": ["measure", "{x}"],
    "measure --config": ["measure", "{results}", "--config", "{x}.toml"],
    "measure --events": ["measure", "{results}", "--events", "{x}"],
    "sync RESULTS": ["sync", "{x}", "{trc}", "-o", "{out}", *BY_GYROSCOPE],
    "sync OTHER": ["sync", "{results}", "{x}.csv", "-o", "{out}", *BY_GYROSCOPE],
    "sync OTHER XDF": ["sync", "{results}", "{x}.xdf", "-o", "{out}", *BY_GYROSCOPE],
    "sync OTHER EDF": ["sync", "{results}", "{x}.edf", "-o", "{out}", *BY_GYROSCOPE],
    "sync --pulse-times": ["sync", "{results}", "{trc}", "-o", "{out}", *BY_PULSES, "{x}.csv"],
    "sync --pulse-times TSV": ["sync", "{results}", "{trc}", "-o", "{out}", *BY_PULSES, "{x}.tsv"],
    "sync --stamps": ["sync", "{results}", "{trc}", "-o", "{out}", "--stamps", "{x}"],
    "verify RESULTS": ["verify", "{x}"],
    "verify RECORDING": ["verify", "{results}", "{x}"],
    "report RESULTS": ["report", "{x}"],
    "report OTHERS": ["report", "{results}", "{x}", "-o", "{out}"],
    "report --reliability": ["report", "{results}", "{results}", "-o", "{out}", "--reliability", "{x}"],
    "report --config": ["report", "{results}", "--config", "{x}.toml"],
    "reliability SESSIONS": ["reliability", "{x}"],
    "reliability OTHERS": ["reliability", "{x}", "{x}"],
    "view RESULTS": ["view", "{x}", "--no-browser"],
    "view RECORDING": ["view", "{results}", "{x}", "--no-browser"],
    "view --corrections": ["view", "{results}", "--corrections", "{x}", "--no-browser"],
    "view --config": ["view", "{results}", "--config", "{x}.toml", "--no-browser"],
    "export --config": ["export", "{results}", "--to", "csv", "-o", "{out}", "--config", "{x}.toml"],
    "export RESULTS": ["export", "{x}", "--to", "csv", "-o", "{out}"],
    "inspect RECORDING": ["inspect", "{x}", "--frame", "0", "-o", "{out}"],
    "inspect --config": ["inspect", "{recording}", "--frame", "0", "-o", "{out}", "--config", "{x}.toml"],
    "equipment fit RECORDING": ["equipment", "fit", "{x}", "-o", "{out}", "--around", "0,0"],
    "motions build SOURCES": ["motions", "build", "{out}.npz", "{x}"],
    "record --config": ["record", "realsense", "-o", "{out}", "--config", "{x}.toml"],
    "record --like": ["record", "realsense", "-o", "{out}", "--like", "{x}"],
    "live SOURCES": ["live", "{x}", "-o", "{out}"],
    "live --calibration": ["live", "{recording}", "-o", "{out}", "--calibration", "{x}"],
    "live --like": ["live", "realsense", "-o", "{out}", "--like", "{x}"],
    "live --config": ["live", "{recording}", "-o", "{out}", "--config", "{x}.toml"],
    "batch RECORDINGS table": ["batch", "{x}.csv", "-o", "{out}"],
    "batch --slurm": ["batch", "{recording}", "-o", "{out}", "--slurm", "{x}"],
    "batch --config": ["batch", "{recording}", "-o", "{out}", "--config", "{x}.toml"],
    "experiment --real": ["experiment", "{out}", "--quick", "--real", "{x}"],
    "experiment --config": ["experiment", "{out}", "--config", "{x}.toml"],
    "benchmark score ANSWERS": ["benchmark", "score", "{x}", "{recording}"],
    "benchmark score FOLDER": ["benchmark", "score", "{recording}", "{x}"],
    "benchmark score --against": ["benchmark", "score", "{recording}", "{recording}", "--against", "{x}"],
    "benchmark score --real": ["benchmark", "score", "{recording}", "--real", "{x}", "--labels", "{recording}"],
    "benchmark score --labels": ["benchmark", "score", "{recording}", "--real", "{recording}", "--labels", "{x}"],
}
"""Each path that a verb reads, as "VERB OPTION", and a command line that comes to read it."""

WRITTEN = {(verb, "OUT") for verb in ("demo", "simulate", "motions build", "experiment", "benchmark make")}
WRITTEN |= {("live", "--record"), ("evaluate", "--json"), ("benchmark score", "--json")}
"""Paths of outputs, beside every --output."""

NOT_READ = {(verb, "angles.parquet") for verb in ("measure", "evaluate")}
NOT_READ |= {(verb, "log.jsonl") for verb in ("evaluate", "view")}
TABLES = ("joints.parquet", "run.json", "angles.parquet", "log.jsonl")
OF_RESULTS = {
    "measure": ["measure", "{copy}"],
    "export": ["export", "{copy}", "--to", "csv", "-o", "{out}"],
    "report": ["report", "{copy}"],
    "view": ["view", "{copy}", "--no-browser"],
    "verify": ["verify", "{copy}"],
    "evaluate": ["evaluate", "{copy}", "--truth", "{truth}"],
}


def path_options(verb: Any = app, path: tuple[str, ...] = ()) -> Iterator[tuple[str, str]]:
    """(verb, option) of every parameter that is a path, by what the command line itself declares."""
    for name in verb:
        if name.startswith("-"):
            continue
        command = verb[name]
        yield from path_options(command, (*path, name))
        if command.default_command is not None:
            for argument in command.assemble_argument_collection():
                if "pathlib.Path" in str(argument.hint) and argument.name != "--output":
                    yield " ".join((*path, name)), argument.name


def test_every_path_of_every_verb_is_tried():
    assert {" ".join(option) for option in set(path_options()) - WRITTEN} <= set(READS)


@pytest.fixture(scope="module")
def places(tmp_path_factory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("given")
    columns = [f"{name}_{axis}_m" for name in JOINT_NAMES for axis in "xyz"]
    rows = [",".join(map(str, (k / 15, *standing_joints().ravel()))) for k in range(40)]
    (folder / "lab.csv").write_text("\n".join([",".join(("time_s", *columns)), *rows]) + "\n")
    (folder / "labels.csv").write_text("camera,frame,joint,u,v\nfront,0,Head,1,1\n")
    return make_places(folder, "session-17") | {"trc": folder / "lab.csv", "labels": folder / "labels.csv"}


class TooLong(Exception):
    """The command line did not return in time."""


@contextmanager
def held() -> Iterator[None]:
    """Ends the work by TooLong or MemoryError where it takes more than some seconds or gigabytes."""

    def stop(*_: object) -> None:
        raise TooLong

    before, own = resource.getrlimit(resource.RLIMIT_AS), int(Path("/proc/self/statm").read_text().split()[0])
    was = signal.signal(signal.SIGALRM, stop)
    resource.setrlimit(resource.RLIMIT_AS, (own * resource.getpagesize() + MOST_BYTES, before[1]))
    signal.alarm(MOST_S)
    try:
        yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, was)
        resource.setrlimit(resource.RLIMIT_AS, before)


def put(kind: str, path: Path) -> None:
    os.mkfifo(path) if kind == "a pipe" else path.symlink_to("/dev/zero")


def require_refusal(arguments: list[str], name: str, capsys: Any) -> None:
    capsys.readouterr()
    with held():
        code = main(arguments)
    answer = " ".join("".join(capsys.readouterr()).split())
    assert code == 2, answer
    assert name in answer, answer
    assert "Traceback" not in answer
    assert len(answer) < 600 + 2 * len(" ".join(arguments)), answer


@pytest.mark.parametrize("kind", ["a pipe", "an endless device"])
@pytest.mark.parametrize("option", READS)
def test_an_option_refuses_what_is_not_a_file(option, kind, places, tmp_path, capsys):
    given = places | {"x": tmp_path / "given", "out": tmp_path / "out"}
    arguments = [each.format(**given) for each in READS[option]]
    (path,) = {each for each in arguments if each.startswith(str(tmp_path / "given"))}
    put(kind, Path(path))
    require_refusal(arguments, Path(path).name, capsys)
    assert not (tmp_path / "out").exists() or option == "experiment --real"  # what it keeps there is gone on with


@pytest.mark.parametrize("kind", ["a pipe", "an endless device"])
@pytest.mark.parametrize(("verb", "table"), [(v, t) for v in OF_RESULTS for t in TABLES if (v, t) not in NOT_READ])
def test_a_results_folder_with_anything_but_files_is_refused(verb, table, kind, places, tmp_path, capsys):
    copy = shutil.copytree(places["results"], tmp_path / "session-17")
    (copy / table).unlink()
    put(kind, copy / table)
    given = {**places, "copy": copy, "out": tmp_path / "out"}
    require_refusal([each.format(**given) for each in OF_RESULTS[verb]], table, capsys)
