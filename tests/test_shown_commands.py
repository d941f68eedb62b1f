"""Every command that the README and the documentation show is one that this program understands, and it works."""

import itertools
import re
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path
from typing import Final

import pytest
from sources_builder import noise, plain_folder

from anchorpose.cli import app, main
from anchorpose.live.cameras import Playback
from anchorpose.recording.reader import open_recording
from anchorpose.results.corrections import corrections_of_run, write_corrections
from anchorpose.results.run_record import read_run
from anchorpose.simulate.config import clinic, single
from anchorpose.simulate.write import simulate_recording
from anchorpose.viewer.server import ViewerServer

ROOT = Path(__file__).parents[1]
PAGES = (ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").glob("**/*.md")))
BLOCK = re.compile(r"^ *```sh\n(.*?)^ *```", re.DOTALL | re.MULTILINE)

SHELL = """
PATH=
anchorpose() { printf '%s\\0' "$@"; printf '\\n'; }
command_not_found_handle() { :; }
"""
"""A shell in which every command succeeds and does nothing, except that ``anchorpose`` prints what it is given."""

PARSED_ONLY: Final = {
    "demo": "the first command of the README, which tests/cli runs",
    "experiment": "hours, and minutes where it is quick; tests/research runs it with a small plan",
    "benchmark": "simulates 0.9 GB; tests/research makes and scores a small one",
    "sync": "needs the file of another device; tests/sync makes them",
    "record --markers": "needs a stream of markers; tests/live/test_markers.py makes one",
    "live --markers": "the same",
    "reliability": "needs the extra 'reliability' and results of many sessions; tests/agreement has them",
    "report --reliability": "the same",
    "report week1": "needs sessions of three weeks; tests/report/test_trend.py makes them",
    "live --finish": "needs a session that was cut off; tests/live/test_finish.py makes them",
    "simulate --movements": "needs captured movements, which are not in the repository",
    "convert .mkv": "needs a file of an Azure Kinect; tests/sources writes them",
    "track .mkv": "the same",
    "check .mkv": "the same",
    "evaluate s1": "needs three sessions and their motion capture; tests/agreement has them",
    "evaluate --labels": "needs labels by eye; tests/agreement has them",
}
"""Commands that are not run here, by the verb and a part of what follows it, and why."""

RECORDINGS = ("example", "s", "sim", "sim3", "sim6", "slow", "standing", "mixed", "squat")  # with a truth beside
SETTINGS = "smooth = false\n[view]\nport = 0\n"  # what settings.toml holds
RESULTS = ("results", "my-results", "other", "r", "before")


def shown() -> list[tuple[str, ...]]:
    """Each command once, as the shell takes it apart."""
    bash = shutil.which("bash")
    if bash is None:
        return []
    script = "\n".join(block for page in PAGES for block in BLOCK.findall(page.read_text(encoding="utf-8")))
    script = script.replace(".venv/bin/", "").replace("/usr/bin/time -v ", "")
    told = subprocess.run([bash, "-c", SHELL + script], capture_output=True, text=True, check=False)
    commands = (tuple(line.split("\0")[:-1]) for line in told.stdout.splitlines() if "\0" in line)
    return list(dict.fromkeys(commands))


COMMANDS = shown()


def is_parsed_only(command: tuple[str, ...]) -> bool:
    rest = " ".join(command[1:])
    return any(verb == command[0] and part in rest for verb, _, part in (key.partition(" ") for key in PARSED_ONLY))


def kind_of(command: tuple[str, ...]) -> tuple[str, ...]:
    """The command without names of files: of those that differ only in these, one is run."""
    options = next((place for place, word in enumerate(command) if word.startswith("-")), len(command))
    return command[:1] + tuple(word for word in command[options:] if "/" not in word and word not in OUTPUTS)


OUTPUTS = {following for one in COMMANDS for option, following in itertools.pairwise(one) if option == "-o"}
RUN = list({kind_of(command): command for command in reversed(COMMANDS) if not is_parsed_only(command)}.values())[::-1]


def shortened(command: tuple[str, ...]) -> list[str]:
    """The command as written, but for the length of what is simulated."""
    if command[0] != "simulate":
        return list(command)
    if "--seconds" not in command:
        return [*command, "--seconds", "0.4"]
    place = command.index("--seconds")
    return [*command[: place + 1], "0.4", *command[place + 2 :]]


@pytest.mark.skipif(shutil.which("bash") is None, reason="the commands are written for a shell")
def test_the_commands_are_found():
    verbs = {command[0] for command in COMMANDS}
    missing = {name for name in app if not name.startswith("-")} - verbs
    assert missing == set()  # every verb is shown
    assert len(COMMANDS) > 60


@pytest.mark.parametrize("command", COMMANDS, ids=" ".join)
def test_a_command_that_is_shown_is_understood(command, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "settings.toml").write_text(SETTINGS)
    app.parse_args(list(command), exit_on_error=False, print_error=False)


def test_every_exception_is_of_use():
    for key in PARSED_ONLY:
        verb, _, part = key.partition(" ")
        assert any(command[0] == verb and part in " ".join(command[1:]) for command in COMMANDS), key


@pytest.fixture(scope="module")
def world(tmp_path_factory) -> Path:
    """A folder with all that the commands name, made of two small recordings and their results."""
    folder = tmp_path_factory.mktemp("world")
    simulate_recording(folder / "example", replace(clinic(5, 4.0, 15.0), cameras=1))
    assert main(["track", str(folder / "example/recording"), "-o", str(folder / "results")]) == 0
    simulate_recording(folder / "later", single(6, seconds=2.0, fps=10.0))  # another session, for comparisons
    assert main(["track", str(folder / "later/recording"), "-o", str(folder / "after")]) == 0
    assert main(["export", str(folder / "results"), "--to", "c3d", "-o", str(folder / "exported")]) == 0
    assert main(["motions", "build", str(folder / "mine.npz"), str(folder / "results")]) == 0
    shutil.copyfile(next((folder / "exported").rglob("*.c3d")), folder / "mocap.c3d")
    for name in RECORDINGS[1:]:
        shutil.copytree(folder / "example", folder / name)
    for name in ("recording", "my-recording", "my-recordings/monday"):
        shutil.copytree(folder / "example/recording", folder / name)
    for name in RESULTS[1:]:
        shutil.copytree(folder / "results", folder / name)
    found = corrections_of_run(folder / "results/run.json", read_run(folder / "results/run.json"))
    write_corrections(folder / "results.corrections.json", replace(found, joints=()))
    (folder / "events.tsv").write_text("onset\tduration\ttrial_type\n0\t1.5\toff\n2\t1.5\ton\n")
    assert main(["measure", str(folder / "my-results"), "--events", str(folder / "events.tsv")]) == 0
    (folder / "settings.toml").write_text(SETTINGS)
    (folder / "images").mkdir()
    plain_folder(folder / "images", noise())
    return folder


def without_outputs(command: tuple[str, ...], folder: Path) -> None:
    """Removes what the command is to make."""
    made = [following for option, following in itertools.pairwise(command) if option == "-o"]
    made += {"simulate": command[1:2], "motions": command[2:3], "convert": command[2:3]}.get(command[0], ())
    if "--overwrite" not in command:
        for path in (folder / name for name in made):
            shutil.rmtree(path) if path.is_dir() else path.unlink(missing_ok=True)


@pytest.mark.slow
@pytest.mark.parametrize("command", RUN, ids=" ".join)
def test_a_command_that_is_shown_works(command, world, tmp_path, monkeypatch, capsys):
    folder = tmp_path / "here"
    shutil.copytree(world, folder)
    without_outputs(command, folder)
    monkeypatch.chdir(folder)

    def camera(serial: str, about: object) -> Playback:
        return Playback(open_recording(Path("example/recording")))

    def stopped(self: ViewerServer) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("anchorpose.live.cameras.open_realsense", camera)
    monkeypatch.setattr(ViewerServer, "serve_forever", stopped)
    monkeypatch.setattr("webbrowser.open", lambda address: True)
    code = main(shortened(command))
    allowed = (0, 1) if command[0] in ("check", "verify") else (0,)  # 1: it found something to say
    assert code in allowed, capsys.readouterr().err
