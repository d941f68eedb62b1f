"""``anchorpose simulate``."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, Literal

from cyclopts import Parameter

from anchorpose.errors import AnchorposeError


def simulate(
    out: Path,
    /,
    *,
    preset: Literal["clinic", "holes", "single"] = "clinic",
    seed: int = 1,
    seconds: float = 10.0,
    fps: float = 15.0,
    hole_radius: float = 0.12,
    cameras: int | None = None,
    sensor: Literal["kinect-v2", "azure-kinect", "realsense"] | None = None,
    therapists: int | None = None,
    motions: Annotated[tuple[str, ...] | None, Parameter(consume_multiple=True)] = None,
    speed: Literal["slow", "normal", "fast", "mixed"] | None = None,
    height: float | None = None,
    scene: Literal["enters-late", "leaves", "hidden", "sits"] | None = None,
    pose_unknown: bool = False,
    rough_recorder: bool = False,
) -> None:
    """Make a recording of a simulated patient, whose true joints are known, to try things out on.

    Parameters
    ----------
    out
        The folder to write: a recording in recording/ and the true joints in truth/truth.npz.
    preset
        clinic: three cameras, standing frame, two therapists. holes: one camera, one person, a hole in the picture in
        about half of the frames. single: one camera, one person, nothing in the way.
    seed
        Another number makes another patient and other movements; the same number makes the same files.
    seconds
        Length of the recording.
    fps
        Pictures a second.
    hole_radius
        Size of the hole of the preset 'holes', in metres.
    cameras
        How many cameras, 1 to 4, instead of the preset's.
    sensor
        Which depth camera is imitated, instead of the preset's.
    therapists
        How many therapists come and go, 0 to 3, instead of the preset's.
    motions
        What the patient does, one or more, such as squat or reach; or mixed.
    speed
        How fast the patient moves, instead of the preset's.
    height
        The patient's height in metres; drawn at random where not given.
    scene
        Something that makes a tracker lose the patient. enters-late: the therapists are there first, he walks in later.
        leaves: he walks out and comes back. hidden: a curtain hides him from all cameras for two seconds. sits: he sits
        down or stands up. Who walks or sits does so without the standing frame. Allow 12 seconds for walking.
    pose_unknown
        Leave the poses of the cameras out of the recording, so that they have to be found.
    rough_recorder
        Record as untidily as real recorders do: the cameras' clocks are up to 2 s apart and drift, stamps jitter by
        4 ms, and 3 of 100 pictures are missing or stored twice.
    """
    from anchorpose.cli.console import progress_bar
    from anchorpose.simulate import config as presets
    from anchorpose.simulate.write import simulate_recording

    given: dict[str, Any] = {
        "cameras": cameras,
        "sensor": sensor,
        "therapists": therapists,
        "motions": motions,
        "speed": speed,
        "height_m": height,
        "pose_known": False if pose_unknown else None,
    }
    try:
        if preset == "holes":
            settings = presets.holes(seed, hole_radius, seconds, fps)
        else:
            settings = {"clinic": presets.clinic, "single": presets.single}[preset](seed, seconds, fps)
        settings = replace(settings, **{name: value for name, value in given.items() if value is not None})
        settings = presets.scene(settings, scene) if scene else settings
        settings = presets.rough_recorder(settings) if rough_recorder else settings
    except ValueError as error:
        raise AnchorposeError(f"{error}.") from None
    with progress_bar("Simulating") as progress:
        simulate_recording(out, settings, progress)
    print(f"The recording is {out / 'recording'}, its true joints are {out / 'truth' / 'truth.npz'}.")
