"""Pulses that both recorded give the clock within 5 ms; pulses that do not tell it are refused."""

import json

import numpy as np
import pytest
from results_builder import make_frame, standing_joints, write_results

from anchorpose.agreement.clock import NoCommonMovement
from anchorpose.cli import main
from anchorpose.sync.pulses import Pulses, find_pulse_clock, pulses_of_signal, rising_edges

OFFSET_S, DRIFT = 1234.5, 4e-5


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    frames = [make_frame(k, 100.0 + k / 10.0, standing_joints()) for k in range(1200)]
    return write_results(tmp_path_factory.mktemp("pulses") / "results", frames)


def onsets_s(seed: int, count: int = 25, lasts_s: float = 110.0) -> np.ndarray:
    return 100.0 + np.sort(np.random.default_rng(seed).uniform(1.0, lasts_s, count))


def true_s(time_s):
    return time_s + OFFSET_S + DRIFT * time_s


def clock_of(ours_s: np.ndarray, theirs_s: np.ndarray, near_s: float | None = None):
    """The clock of onsets whose ends are unknown."""
    return find_pulse_clock([Pulses(ours_s)], [Pulses(theirs_s)], near_s)


def write_signal(path, at_s: np.ndarray, hz: float, high: float = 5.0, lasts_s: float | np.ndarray = 0.05) -> None:
    """A pulse at each onset, by the other clock."""
    time_s = np.arange(true_s(at_s[0]) - 5.0, true_s(at_s[-1]) + np.max(lasts_s) + 5.0, 1.0 / hz)
    since = time_s - np.append(-np.inf, true_s(at_s))[np.searchsorted(true_s(at_s), time_s, side="right")]
    noise = np.random.default_rng(1).normal(scale=0.02, size=len(time_s))
    lasts_s = np.append(0.0, np.broadcast_to(lasts_s, at_s.shape))[np.searchsorted(true_s(at_s), time_s, side="right")]
    rows = np.column_stack([time_s, np.where(since < lasts_s, high, 0.0) + noise, noise])
    np.savetxt(path, rows, fmt="%.5f", delimiter=",", header="time_s,trigger,emg", comments="")


def write_events(path, at_s: np.ndarray, lasts: str = "0.05") -> None:
    rows = [f"{each - 100.0:.4f}\t{lasts}\tpulse" for each in at_s] + ["3.0\t20.0\tstimulation"]
    path.write_text("\n".join(["onset\tduration\ttrial_type", *rows]) + "\n")


@pytest.mark.parametrize(("hz", "high"), [(1000.0, 5.0), (100.0, -5.0)])
def test_the_clock_is_found_within_5_ms_and_three_sigma(results, hz, high, tmp_path):
    shared = onsets_s(3)
    write_signal(tmp_path / "emg.csv", shared[2:], hz, high)
    write_events(tmp_path / "events.tsv", shared[:-3])
    options = ("--pulses", "trigger", "--pulse-times", str(tmp_path / "events.tsv"), "--pulse-type", "pulse")
    assert main(["sync", str(results), str(tmp_path / "emg.csv"), "-o", str(tmp_path / "out"), *options]) == 0
    clock = json.loads((tmp_path / "out/clock.json").read_text(encoding="utf-8"))
    off_s = clock["at_s"] + clock["offset_s"] - true_s(clock["at_s"])
    assert abs(off_s) < 0.005
    assert abs(off_s) < 3.0 * clock["offset_sigma_s"]
    assert abs(clock["drift_ppm"] - 1e6 * DRIFT) < 3.0 * clock["drift_sigma_ppm"]
    assert clock["method"] == "pulses"


LASTS_S = np.random.default_rng(5).uniform(0.03, 0.3, 25)


@pytest.mark.parametrize(("form", "lasts_s"), [("times", LASTS_S), ("signal", 0.05), ("signal", LASTS_S)])
def test_pulses_on_the_recordings_clock_may_be_times_or_a_signal(results, form, lasts_s, tmp_path):
    shared = onsets_s(4)
    write_signal(tmp_path / "emg.csv", shared, 1000.0, lasts_s=lasts_s)
    ours = tmp_path / "ours.csv"
    if form == "times":
        ours.write_text("time_s\n" + "".join(f"{each:.4f}\n" for each in shared))
    else:
        time_s = np.arange(99.0, 215.0, 0.001)
        ends_s = (shared + lasts_s)[np.clip(np.searchsorted(shared, time_s) - 1, 0, None)]
        high = ((time_s > shared[0]) & (time_s < ends_s)) * 1.0
        np.savetxt(ours, np.column_stack([time_s, high]), delimiter=",", header="time_s,trigger", comments="")
    options = ("--pulses", "trigger", "--pulse-times", str(ours))
    assert main(["sync", str(results), str(tmp_path / "emg.csv"), "-o", str(tmp_path / "out"), *options]) == 0
    clock = json.loads((tmp_path / "out/clock.json").read_text(encoding="utf-8"))
    assert clock["at_s"] + clock["offset_s"] == pytest.approx(true_s(clock["at_s"]), abs=0.005)


GATE_S = 100.0 + np.cumsum(10.0 + np.random.default_rng(1).uniform(3.0, 8.0, 18))


@pytest.mark.parametrize("high", [5.0, -5.0])
def test_a_gate_that_is_on_most_of_the_time_is_read_by_its_durations_or_near_and_refused_without(
    results, high, tmp_path, capsys
):
    """The ends of equal pulses fit the onsets as well as the starts do: the clock was wrong by 10 s, ± 1 ms."""
    write_signal(tmp_path / "emg.csv", GATE_S, 200.0, high, lasts_s=10.0)
    options = ("--pulses", "trigger", "--pulse-times", str(tmp_path / "events.tsv"), "--pulse-type", "pulse")
    command = ["sync", str(results), str(tmp_path / "emg.csv"), "-o", str(tmp_path / "out"), "--overwrite", *options]
    write_events(tmp_path / "events.tsv", GATE_S, "n/a")
    assert main(command) == 2
    said = capsys.readouterr().err
    assert "match 18 and 18 starts and ends of pulses" in said
    assert "state --near SECONDS" in said
    near = ["--near", "1234.4"]
    for lasts, more in (("10.0", []), ("n/a", near), ("0", near)):
        write_events(tmp_path / "events.tsv", GATE_S, lasts)
        assert main([*command, *more]) == 0
        clock = json.loads((tmp_path / "out/clock.json").read_text(encoding="utf-8"))
        off_s = clock["at_s"] + clock["offset_s"] - true_s(clock["at_s"])
        assert abs(off_s) < min(0.005, 4.0 * clock["offset_sigma_s"])


def test_starts_and_ends_of_very_short_pulses_differ_less_than_the_stated_error():
    time_s = np.arange(0.0, 120.0, 0.001)
    onsets = onsets_s(11) - 100.0
    since = time_s - np.append(-np.inf, onsets)[np.searchsorted(onsets, time_s, side="right")]
    clock, matched = find_pulse_clock([Pulses(onsets + 7.0)], pulses_of_signal(time_s, (since < 0.01) * -5.0))
    assert matched == 25
    assert abs(clock.offset_s + 7.0 - 0.005) < 0.001
    assert clock.offset_sigma_s == pytest.approx(0.005, abs=0.001)


def test_a_reading_that_is_too_evenly_spaced_is_refused_though_the_other_fits_at_one_offset():
    """The starts are even; half of the ends happen to be."""
    ours = np.arange(10.0, 30.0)
    theirs = ours + 5.0 + np.where(np.arange(20) % 2, 0.5, np.random.default_rng(2).uniform(0.2, 0.9, 20))
    with pytest.raises(NoCommonMovement, match="match 20 and 19 starts"):
        find_pulse_clock([Pulses(ours)], [Pulses(ours + 5.0), Pulses(theirs)])


def test_a_law_the_clock_moves_with_the_pulses():
    ours = onsets_s(5)
    for shift_s in (-50.0, 0.0, 1e6):
        assert clock_of(ours, ours + shift_s)[0].offset_s == pytest.approx(shift_s, abs=1e-6)


def test_lost_and_foreign_pulses_do_not_matter():
    rng = np.random.default_rng(6)
    ours = onsets_s(6, 40)
    theirs = np.sort(np.append(true_s(ours[rng.random(40) > 0.2]), true_s(onsets_s(7, 4))))
    clock, matched = clock_of(ours, theirs)
    assert abs(float(clock.reference_time_s(np.array([150.0]))[0] - true_s(150.0))) < 0.003
    assert matched > 25


def test_even_pulses_are_refused_unless_the_offset_is_nearly_known():
    ours = np.arange(0.0, 20.0)
    with pytest.raises(NoCommonMovement, match="match 20 and 19 starts and ends"):
        clock_of(ours, ours + 7.1)
    assert clock_of(ours, ours + 7.1, near_s=7.0)[0].offset_s == pytest.approx(7.1)


def test_other_pulses_are_refused():
    with pytest.raises(NoCommonMovement):
        clock_of(onsets_s(8), onsets_s(9))


def test_edges_of_a_signal_with_slow_and_noisy_edges():
    time_s = np.arange(0.0, 10.0, 0.01)
    rise = np.clip((np.abs((time_s % 2.0) - 1.0) - 0.8) / 0.1, 0.0, 1.0)
    noise = np.random.default_rng(2).normal(scale=0.03, size=len(time_s))
    np.testing.assert_allclose(rising_edges(time_s, rise + noise), [1.85, 3.85, 5.85, 7.85, 9.85], atol=0.02)
    assert len(rising_edges(time_s, np.ones_like(time_s))) == 0


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--pulses", "trigger"), "--pulses needs --pulse-times"),
        (("--pulses", "button", "--pulse-times", "events.tsv"), "has no signal 'button'"),
        (("--pulses", "trigger", "--pulse-times", "events.tsv", "--pulse-type", "beep"), "no row of the trial_type"),
        (("--pulses", "trigger", "--pulse-times", "head.tsv"), "has no columns onset and trial_type"),
        (("--pulses", "trigger", "--pulse-times", "none.tsv"), "no such file"),
        (("--pulses", "trigger", "--pulse-times", "text.tsv"), "has the time 'soon'"),
        (("--pulses", "trigger", "--pulse-times", "x.txt"), "ends in '.txt'"),
        (("--pulses", "emg", "--pulse-times", "events.tsv"), "pulses in emg"),
    ],
)
def test_what_cannot_be_used_is_refused_in_one_sentence(results, options, words, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    write_signal(tmp_path / "emg.csv", onsets_s(3), 1000.0)
    write_events(tmp_path / "events.tsv", onsets_s(3))
    (tmp_path / "head.tsv").write_text("start\tend\n1\t2\n")
    (tmp_path / "text.tsv").write_text("onset\tduration\ttrial_type\nsoon\t1\tpulse\n")
    assert main(["sync", str(results), "emg.csv", "-o", "out", *options]) == 2
    said = capsys.readouterr().err
    assert words in said
    assert said.count("\n") == 1
