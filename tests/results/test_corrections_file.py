"""The file of a reviewer's corrections: kept whole, never shortened, refused with the place where it is wrong."""

from collections.abc import Callable
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from recording_builder import edit_json

from anchorpose.errors import InputError
from anchorpose.recording.recording import Clock
from anchorpose.results.corrections import (
    Corrections,
    JointCorrection,
    NamedPatient,
    UnusableInterval,
    Withdrawal,
    corrections_of_run,
    read_corrections,
    require_recording,
    write_corrections,
)
from anchorpose.results.reviewed_recording import (
    ReviewedCamera,
    ReviewedRecording,
    recording_of_run,
    reviewed_recording,
)
from anchorpose.results.run_record import as_json

WHEN = "2026-03-01T09:30:00Z"
POSE = np.array([[0, 0, -1, 2.5], [0, -1, 0, 1.2], [-1, 0, 0, 0.1], [0, 0, 0, 1.0]])
HASHES = (("recording.json", "a" * 64), ("front/timestamps.csv", "b" * 64), ("front/depth/000000.png", "c" * 64))

INTERVAL = UnusableInterval(
    first_frame=3, last_frame=9, start_s=0.3, end_s=0.9, reason="a curtain", who="AB", when=WHEN
)


def knee(x: float = 0.1, who: str = "AB") -> JointCorrection:
    return JointCorrection(
        frame=4,
        time_s=0.4,
        joint="KneeLeft",
        position_m=(x, 0.5, -0.1),
        sigma_m=0.02,
        reason="sat on the bar",
        who=who,
        when=WHEN,
    )


def patient(z: float = 0.3, who: str = "AB") -> NamedPatient:
    return NamedPatient(frame=7, time_s=0.7, position_m=(0.1, 1.1, z), reason="the other one", who=who, when=WHEN)


def described(
    name: str,
    hashes: tuple[tuple[str, str], ...],
    poses: dict[str, np.ndarray | None],
    clocks: dict[str, Clock] | None = None,
    floor_m: float | None = None,
) -> ReviewedRecording:
    cameras = [ReviewedCamera(camera, pose, (clocks or {}).get(camera)) for camera, pose in poses.items()]
    return reviewed_recording(name, hashes, cameras, floor_m)


def reviewed() -> ReviewedRecording:
    clocks = {"front": Clock(), "left": Clock(ahead_s=1.5, drift=-2e-5, at_s=3.0)}
    return described("ward", HASHES, {"front": POSE, "left": None}, clocks, -0.005)


def written(path: Path) -> Path:
    write_corrections(path, Corrections(reviewed()).added(INTERVAL).added(knee(0.2)).added(knee()).added(patient()))
    return path


def test_what_is_written_is_read_back(tmp_path: Path) -> None:
    found = read_corrections(written(tmp_path / "c.json"))
    assert found.unusable == (INTERVAL,)
    assert found.joints == (knee(),)
    assert found.withdrawn == (Withdrawal(knee(0.2), "AB", WHEN),)
    require_recording(tmp_path / "c.json", found, reviewed())
    assert np.array_equal(found.recording.poses["front"], POSE)
    assert found.recording.poses["left"] is None
    assert (found.recording.clocks, found.recording.floor_height_m) == (reviewed().clocks, -0.005)


def test_taking_back_a_second_correction_makes_the_first_one_hold_again(tmp_path: Path) -> None:
    first, second, third = (replace(knee(x), when=f"2026-03-01T09:3{x:.0f}:00Z") for x in (1, 2, 3))
    elsewhere = replace(knee(), frame=5)
    held = Corrections(reviewed()).added(first).added(elsewhere).added(second).added(third)
    assert held.joints == (elsewhere, third)
    by = ("CD", "2026-03-02T10:00:00Z")
    for undone, left in ((third, {elsewhere, second}), (second, {elsewhere, first}), (first, {elsewhere})):
        held = held.taken_back(Withdrawal(undone, *by))
        assert set(held.joints) == left
        write_corrections(tmp_path / "c.json", held)
        held = read_corrections(tmp_path / "c.json")
    assert held.withdrawn == tuple(Withdrawal(each, *by) for each in (third, second, first))
    again = held.added(replace(second, who="EF"))
    assert again.taken_back(Withdrawal(again.joints[-1], *by)).joints == (
        elsewhere,
    )  # what was taken back itself stays so


def test_who_the_patient_is_holds_once_and_comes_back(tmp_path: Path) -> None:
    first, second = patient(), replace(patient(0.9), frame=4, when="2026-03-01T09:31:00Z")  # of the knee's frame
    held = Corrections(reviewed()).added(first).added(knee()).added(INTERVAL).added(second)
    write_corrections(tmp_path / "c.json", held)
    found = read_corrections(tmp_path / "c.json")
    assert (found.patient, found.joints, found.unusable) == (second, (knee(),), (INTERVAL,))
    assert found.withdrawn == (Withdrawal(first, "AB", second.when),)
    by = ("CD", "2026-03-02T10:00:00Z")
    write_corrections(tmp_path / "c.json", found.taken_back(Withdrawal(second, *by)))
    found = read_corrections(tmp_path / "c.json")
    assert (found.patient, found.withdrawn) == (first, (Withdrawal(second, *by),))
    assert found.taken_back(Withdrawal(first, *by)).patient is None
    with pytest.raises(ValueError, match="does not exist"):
        found.taken_back(Withdrawal(second, *by))


def test_a_file_without_patient_and_clocks_is_one_of_an_older_release(tmp_path: Path) -> None:
    path = written(tmp_path / "c.json")

    def older(document: dict[str, Any]) -> None:
        document.pop("patient")
        document["recording"].pop("floor_height_m")
        for camera in document["recording"]["cameras"]:
            camera.pop("clock")

    edit_json(path, older)
    found = read_corrections(path)
    assert (found.patient, found.recording.clocks, found.recording.floor_height_m) == (None, {}, None)


def test_the_file_keeps_what_it_held_where_writing_fails_or_could_not_be_read_back(tmp_path: Path) -> None:
    path = written(tmp_path / "c.json")
    before = path.read_bytes()
    held = read_corrections(path)
    for unreadable in (held.taken_back(Withdrawal(INTERVAL, "", WHEN)), held.added(replace(INTERVAL, first_frame=-1))):
        with pytest.raises(InputError, match=r"c\.json"):
            write_corrections(path, unreadable)
    assert path.read_bytes() == before
    with pytest.raises(ValueError, match="is 0, before first_frame 3"):
        replace(INTERVAL, last_frame=0)
    endless = Corrections(described("ward", HASHES, {"front": np.full((4, 4), np.nan)}))
    with pytest.raises(ValueError, match="JSON"):
        write_corrections(path, endless)
    assert (path.read_bytes(), [file.name for file in tmp_path.iterdir()]) == (before, ["c.json"])


def test_a_recording_is_known_by_its_pictures_and_times_whatever_else_changes() -> None:
    edited = (("recording.json", "f" * 64), *HASHES[1:], ("equipment.json", "e" * 64))
    assert described("renamed", edited[::-1], {}).sha256 == reviewed().sha256
    other = (*HASHES[:2], ("front/depth/000000.png", "d" * 64))
    assert described("ward", other, {}).sha256 != reviewed().sha256


def test_corrections_of_another_recording_or_world_are_refused(tmp_path: Path) -> None:
    found = read_corrections(written(tmp_path / "c.json"))
    other = described("ward", HASHES[:2], {"front": POSE, "left": None})
    with pytest.raises(InputError, match=r"another recording \('ward'"):
        require_recording(tmp_path / "c.json", found, other)
    for poses in ({"front": POSE + 0.002, "left": None}, {"front": POSE, "left": POSE}, {"front": POSE}):
        with pytest.raises(InputError, match="another world"):
            require_recording(tmp_path / "c.json", found, described("ward", HASHES, poses))
    require_recording(tmp_path / "c.json", found, described("ward", HASHES, {"front": POSE + 5e-4, "left": None}))


def test_the_recording_of_a_run_is_read_from_its_record() -> None:
    clock = {"ahead_s": 1.5, "drift": -2e-5, "at_s": 3.0}
    cameras = [
        {"name": "front", "camera_to_world": POSE.tolist()},
        {"name": "left", "camera_to_world": None, "clock": clock},
    ]
    run = {"recording": "ward", "inputs_sha256": dict(HASHES), "cameras": cameras}
    assert recording_of_run(run).sha256 == reviewed().sha256
    assert np.array_equal(recording_of_run(run).poses["front"], POSE)
    assert recording_of_run(run).clocks == {"left": Clock(**clock)}


def test_a_run_that_states_corrections_which_are_none_is_refused() -> None:
    run = {"recording": "ward", "inputs_sha256": dict(HASHES), "cameras": []}
    assert corrections_of_run(Path("run.json"), {**run, "corrections": None}).joints == ()
    told = {"file": "c.json", "sha256": "a" * 64, "unusable": [], "joints": [{**asdict(knee()), "joint": "Knee"}]}
    with pytest.raises(InputError, match=r"run.json: corrections.joints\[0\].joint is \"Knee\""):
        corrections_of_run(Path("run.json"), {**run, "corrections": as_json(told)})


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (lambda d: d.update(format="calibration"), 'format is "calibration"'),
        (lambda d: d.update(version=2), "version is 2"),
        (lambda d: d.update(unuseable=[]), "did you mean 'unusable'"),
        (lambda d: d.pop("joints"), "the key 'joints' is missing"),
        (lambda d: d["joints"][0].update(joint="Kneeleft"), r"\[0\].joint is \"Kneeleft\"; did you mean 'KneeLeft'"),
        (lambda d: d["joints"][0].update(position_m=[1, 2]), r"joints\[0\].position_m is not a list of 3"),
        (lambda d: d["joints"][0].update(position_m=[100, 500, -101]), r"\[0\].position_m is more than 100 m"),
        (lambda d: d["joints"][0].update(sigma_m=0), r"joints\[0\].sigma_m is 0"),
        (lambda d: d["joints"][0].update(sigma_m=1e-300), r"joints\[0\].sigma_m is 1e-300; it must be at least 0.0001"),
        (lambda d: d["joints"][0].update(time_s=1e308), r"joints\[0\].time_s is 1e\+308; it must be at most"),
        (lambda d: d["joints"][0].update(frame=1.5), r"joints\[0\].frame is 1.5"),
        (lambda d: d["joints"].append(d["joints"][0]), "joints has KneeLeft of frame 4 twice"),
        (lambda d: d["unusable"][0].update(last_frame=2), r"unusable\[0\].last_frame is 2, before first_frame 3"),
        (lambda d: d["unusable"][0].update(end_s=0.1), r"unusable\[0\].end_s is 0.1, before"),
        (lambda d: d["unusable"][0].update(who=" "), r'unusable\[0\].who is " "; it must have at least 1 character'),
        (lambda d: d["unusable"][0].update(when="2026-03-01T09:30:00"), r"unusable\[0\].when .* write the time in UTC"),
        (lambda d: d["patient"].update(position_m=[1, 2]), r"patient.position_m is not a list of 3"),
        (lambda d: d["patient"].update(joint="Head"), r"patient"),
        (lambda d: d["patient"].pop("who"), r"the key 'patient.who' is missing|patient.*'who'"),
        (lambda d: d["withdrawn"][0]["entry"].update(joint="Hip"), r"withdrawn\[0\].entry.joint is \"Hip\""),
    ],
)
def test_a_file_that_is_wrong_is_refused_with_the_place(
    tmp_path: Path, change: Callable[[dict[str, Any]], Any], told: str
) -> None:
    path = written(tmp_path / "c.json")
    edit_json(path, change)
    with pytest.raises(InputError, match=told):
        read_corrections(path)
