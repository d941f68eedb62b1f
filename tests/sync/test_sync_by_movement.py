"""The clock of a sensor on the thigh is found from the thigh's movement, and refused where it cannot be."""

import json

import numpy as np
import pytest
from sensor_builder import Sensor, make_sensor

from anchorpose.agreement.clock import NoCommonMovement, Signals
from anchorpose.cli import main
from anchorpose.results.tables import read_joints
from anchorpose.sync.movement import find_sensor_clock

ACCELERATION, GYROSCOPE = ("--acceleration", "ax,ay,az"), ("--gyroscope", "gx,gy,gz")


@pytest.fixture(scope="module")
def sensor(tmp_path_factory) -> Sensor:
    return make_sensor(tmp_path_factory.mktemp("sensor"), seed=5, seconds=40.0)


def synchronised(sensor: Sensor, other, out, *options: str) -> int:
    options = options if "--segment" in options else ("--segment", "thigh_right", *options)
    return main(["sync", str(sensor.results), str(other), "-o", str(out), *options])


def off_s(sensor: Sensor, clock: dict) -> float:
    """How far the stated clock is from the true one at the time that it is stated for."""
    return clock["at_s"] + clock["offset_s"] - float(sensor.true_s(clock["at_s"]))


@pytest.mark.parametrize("way", [ACCELERATION, GYROSCOPE, ("--acceleration", "ay")])
def test_the_clock_is_found_within_30_ms_and_three_sigma(sensor, way, tmp_path):
    assert synchronised(sensor, sensor.write_csv(tmp_path / "imu.csv"), tmp_path / "out", *way) == 0
    clock = json.loads((tmp_path / "out/clock.json").read_text(encoding="utf-8"))
    assert abs(off_s(sensor, clock)) < 0.03
    assert abs(off_s(sensor, clock)) < 3.0 * clock["offset_sigma_s"]
    assert clock["method"] == "movement"
    assert clock["notes"] == []


def test_a_sensor_that_starts_late_and_stops_early_is_found(sensor, tmp_path):
    other = sensor.write_csv(tmp_path / "imu.csv", slice(900, 3100))
    assert synchronised(sensor, other, tmp_path / "out", *ACCELERATION) == 0
    clock = json.loads((tmp_path / "out/clock.json").read_text(encoding="utf-8"))
    assert abs(off_s(sensor, clock)) < 0.03
    assert clock["common_s"][0] == pytest.approx(9.0, abs=1.0)


@pytest.mark.thorough
def test_drift_is_found_in_a_long_recording(tmp_path):
    for seed in (7, 8):
        sensor = make_sensor(tmp_path / str(seed), seed, 120.0)
        assert (
            synchronised(sensor, sensor.write_csv(tmp_path / "imu.csv"), tmp_path / str(seed) / "out", *GYROSCOPE) == 0
        )
        clock = json.loads((tmp_path / str(seed) / "out/clock.json").read_text(encoding="utf-8"))
        assert abs(off_s(sensor, clock)) < 0.03
        assert abs(clock["drift_ppm"] - 1e6 * sensor.drift) < 3.0 * clock["drift_sigma_ppm"] <= 300.0


def test_the_clock_does_not_depend_on_how_the_sensor_is_mounted_or_on_its_unit():
    rng = np.random.default_rng(4)
    time_s = np.arange(0.0, 30.0, 0.01)
    ours = np.cumsum(rng.normal(size=(len(time_s), 3)), axis=0)
    ours -= np.linspace(ours[0], ours[-1], len(ours))
    mounting = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    found = [
        find_sensor_clock(Signals(time_s, ours), Signals(time_s + 3.0, theirs))
        for theirs in (ours, 57.3 * ours @ mounting + 9.81)
    ]
    assert [each.offset_s for each in found] == pytest.approx([3.0, 3.0], abs=1e-3)
    assert [each.correlation for each in found] == pytest.approx([1.0, 1.0], abs=1e-6)


def test_movement_of_a_single_frequency_is_refused_unless_the_offset_is_nearly_known():
    time_s = np.arange(0.0, 30.0, 0.01)
    swing = np.sin(2.0 * np.pi * time_s / 1.3)[:, None] * [1.0, 0.5, 0.1]
    ours, theirs = Signals(time_s, swing), Signals(time_s + 2.0, swing)
    with pytest.raises(NoCommonMovement, match="repeats itself"):
        find_sensor_clock(ours, theirs)
    assert find_sensor_clock(ours, theirs, near_s=2.1).offset_s == pytest.approx(2.0, abs=1e-3)


def test_another_recording_is_refused_in_one_sentence(sensor, tmp_path, capsys):
    other = make_sensor(tmp_path / "other", seed=6, seconds=40.0).write_csv(tmp_path / "imu.csv")
    for way in (ACCELERATION, GYROSCOPE):
        assert synchronised(sensor, other, tmp_path / "out", *way) == 2
        said = capsys.readouterr().err
        assert said.count("\n") == 1
        assert "shares no movement of the segment thigh_right" in said
    assert not (tmp_path / "out").exists()


def test_a_sensor_at_rest_is_refused(sensor, tmp_path, capsys):
    rng = np.random.default_rng(1)
    rows = np.column_stack(
        [sensor.clock_s, np.array([0.0, 1.0, 0.0]) + rng.normal(scale=0.01, size=(len(sensor.time_s), 3))]
    )
    np.savetxt(tmp_path / "rest.csv", rows, delimiter=",", header="time_s,ax,ay,az", comments="")
    assert synchronised(sensor, tmp_path / "rest.csv", tmp_path / "out", *ACCELERATION) == 2
    assert "shares no movement" in capsys.readouterr().err


def test_joints_and_signals_are_at_the_same_times(sensor, tmp_path):
    import pyarrow.parquet as pq

    assert synchronised(sensor, sensor.write_csv(tmp_path / "imu.csv"), tmp_path / "out", *ACCELERATION) == 0
    ours, moved = (
        read_joints(path) for path in (sensor.results / "joints.parquet", tmp_path / "out/joints_other_clock.parquet")
    )
    signals = pq.read_table(tmp_path / "out/signals.parquet")
    np.testing.assert_array_equal(moved.position_m, ours.position_m)
    np.testing.assert_allclose(moved.time_s, signals["other_time_s"].to_numpy())
    np.testing.assert_allclose(moved.time_s, sensor.true_s(ours.time_s), atol=0.03)
    expected = np.interp(signals["other_time_s"].to_numpy(), sensor.clock_s, sensor.acceleration[:, 1])
    assert np.median(np.abs(signals["ay"].to_numpy() - expected)) < 0.02
    assert (signals["ay_rms"].to_numpy() >= np.abs(signals["ay"].to_numpy()) - 1e-9).all()


def test_results_are_replaced_only_when_asked(sensor, tmp_path, capsys):
    other = sensor.write_csv(tmp_path / "imu.csv")
    assert synchronised(sensor, other, tmp_path / "out", *GYROSCOPE) == 0
    assert synchronised(sensor, other, tmp_path / "out", *GYROSCOPE) == 2
    assert "exists already" in capsys.readouterr().err
    assert synchronised(sensor, other, tmp_path / "out", "--overwrite", *GYROSCOPE) == 0


GOOD = "time_s,ax,ay,az\n0,1,2,3\n0.1,1,2,4\n0.2,1,2,3\n"


@pytest.mark.parametrize(
    ("content", "options", "words"),
    [
        (GOOD, ("--acceleration", "ax,ay,aq"), "has no signal 'aq'; name one of ax, ay, az"),
        (GOOD, (), "Give one of --acceleration, --gyroscope, --pulses"),
        (GOOD, (*ACCELERATION, *GYROSCOPE), ", not --acceleration and --gyroscope together"),
        (GOOD, (*ACCELERATION, "--time", "clock"), "has no column clock; name the column of the times"),
        (GOOD.replace("time_s", "t"), ACCELERATION, "has no column time_s"),
        (GOOD.replace("0.2,", "0.1,"), ACCELERATION, "its time does not rise at sample 3"),
        (GOOD.replace("0.2,", ","), ACCELERATION, "without a time"),
        (GOOD.replace("0.2,", "2000000,"), ACCELERATION, "give its times in seconds"),
        (GOOD.replace("0.1,1", "0.1,one"), ACCELERATION, "cannot be read as a table of numbers"),
        (GOOD.replace("0.1,1,2,4", "0.1,1"), ACCELERATION, "cannot be read as a table of numbers"),
        (GOOD.replace("ay", "ax"), ACCELERATION, "has two columns 'ax'"),
        ("time_s,ax,ay,az\n0,1,2,3\n", ACCELERATION, "has 1 samples"),
        ("time_s,ax,ay,az\n0,,,\n1,,,\n", ACCELERATION, "has no values"),
        (bytes(range(256)) * 40, ACCELERATION, "is not a CSV file"),
        (b"\xff\xd8\xff\xe0" * 40, ACCELERATION, "is not text in UTF-8; write one line of names"),
        (
            GOOD.encode().replace(b"0.1,1", b"0.1,\xff"),
            ACCELERATION,
            "cannot be read as a table of numbers (In CSV column #1: Row #3",
        ),
        (b"\x00" * 4096, ACCELERATION, "is not a CSV file"),
        ("", ACCELERATION, "begins with the line ''"),
        (GOOD, ACCELERATION, "have less than 1.5 s in common"),
    ],
)
def test_unusable_files_are_refused_in_one_sentence(sensor, content, options, words, tmp_path, capsys):
    (tmp_path / "imu.csv").write_bytes(content if isinstance(content, bytes) else content.encode())
    assert synchronised(sensor, tmp_path / "imu.csv", tmp_path / "out", *options) == 2
    said = capsys.readouterr().err
    assert words in said
    assert said.count("\n") == 1
    assert not (tmp_path / "out").exists()


def test_a_file_that_is_too_large_missing_or_of_another_kind_is_refused(sensor, tmp_path, capsys):
    with (tmp_path / "large.csv").open("wb") as file:
        file.truncate(2**30)
    (tmp_path / "notes.txt").write_text(GOOD)
    for name, words in (
        ("large.csv", "536,870,912 at most"),
        ("none.csv", "no such file"),
        ("notes.txt", "ends in '.txt'"),
    ):
        assert synchronised(sensor, tmp_path / name, tmp_path / "out", *ACCELERATION) == 2
        assert words in capsys.readouterr().err


def test_a_segment_is_needed(sensor, tmp_path, capsys):
    other = sensor.write_csv(tmp_path / "imu.csv")
    assert main(["sync", str(sensor.results), str(other), "-o", str(tmp_path / "out"), *ACCELERATION]) == 2
    assert "needs --segment" in capsys.readouterr().err
