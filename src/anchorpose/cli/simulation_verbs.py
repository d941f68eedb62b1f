"""Define the command simulate, which makes a recording whose true joints are known."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from cyclopts import Parameter

from anchorpose.cli.console import progress_bar, say
from anchorpose.cli.settings_file import SettingsFile
from anchorpose.errors import AnchorposeError, InputError
from anchorpose.options import DAY_S, FASTEST_HZ, LARGEST_SEED, TALLEST_M, between, positive, whole
from anchorpose.simulate.choices import BraceName, Build, Equipment, LensName, Scene, Sensor, Speed, When

if TYPE_CHECKING:
    from anchorpose.simulate.bodies import OtherBody
    from anchorpose.simulate.config import SimulationConfig


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class SessionOptions:
    """The options of ``anchorpose simulate`` for the preset 'stimulation'."""

    trials: Annotated[int | None, whole(2, 200)] = None
    """Number of trials, half of them with stimulation; 12 by default."""

    trial_s: Annotated[float | None, Parameter(name="--trial-seconds"), positive(3600.0)] = None
    """Length of each trial in seconds, at least 10; 20 by default. Before each trial and after
    the last is a pause of 4 seconds."""

    effect_deg: Annotated[float | None, between(0.0, 10.0)] = None
    """By how many degrees knees are straighter with stimulation; 5 by default, 0 for no effect. No knee gets straighter
    than 1 degree."""

    effect_s: Annotated[float | None, Parameter(name="--effect-seconds"), between(0.0, 3600.0)] = None
    """By how many seconds knees stay extended longer with stimulation; 0 by default."""

    helped: When | None = None
    """The trials in which therapists hold knees and hips; by default the trials without stimulation."""

    hands_off: When | None = None
    """The trials in which the hands are off the rails; by default the trials with stimulation."""

    incidents: Annotated[int | None, whole(0, 50)] = None
    """Number of incidents of each kind (buckling knee, failed stand, recovery step, clonus); 1 by default."""

    @property
    def given(self) -> dict[str, Any]:
        """Return the options that are given, by their names in ``SessionConfig``."""
        return {name: value for name, value in vars(self).items() if value is not None}


DEFAULT_S, DEFAULT_HOLE_M = 10.0, 0.12  # s, m; the defaults of --seconds and --hole-radius


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class SimulateOptions:
    """The options of ``anchorpose simulate``."""

    preset: Literal["clinic", "holes", "single", "rehabilitation", "room", "stimulation"] = "clinic"
    """clinic: three cameras, standing frame, two therapists. holes: one camera, one person, a hole in the depth image
    in about half of the frames. single: one camera, one person, no occlusion. rehabilitation: three cameras, two
    therapists, and a patient who does a captured movement; it needs --movements. room: one camera at an unknown place
    in a cluttered room; its seed decides whether there are other people, a mirror or moved furniture. stimulation: a
    session of trials with and without stimulation, with the true events and conditions; its length follows from the
    trials."""

    seed: Annotated[int, whole(0, LARGEST_SEED)] = 1
    """Number from which everything random is drawn: another number gives another patient and other movements, the same
    number the same files."""

    seconds: Annotated[float | None, positive(DAY_S)] = None
    """Length of the recording in seconds; 10 by default. A session of the preset 'stimulation' lasts as long as its
    trials."""

    fps: Annotated[float, positive(FASTEST_HZ)] = 15.0
    """Frames per second."""

    hole_radius: Annotated[float | None, positive(1.0)] = None
    """Radius of the hole of the preset 'holes', in metres; 0.12 by default."""

    cameras: Annotated[int | None, whole(1, 100)] = None
    """Number of cameras, 1 to 4; by default that of the preset."""

    sensor: Annotated[tuple[Sensor, ...] | None, Parameter(consume_multiple=True)] = None
    """The depth camera that is imitated, one for all cameras or one per camera; by default that of the preset.
    realsense is a D455; kinect-v1 is coarse, at half resolution; realsense-filtered smooths over space and time as
    librealsense does."""

    lens: LensName | None = None
    """The lens: a pinhole, or one of OpenCV's models with realistic coefficients; by default that of the sensor."""

    therapists: Annotated[int | None, whole(0, 100)] = None
    """Number of therapists who come and go, 0 to 3; by default that of the preset."""

    motions: Annotated[tuple[str, ...] | None, Parameter(consume_multiple=True)] = None
    """One or more motions that the patient does, such as squat or reach; or 'mixed'."""

    movements: Path | None = None
    """File of captured movements for the presets 'rehabilitation' and 'room': the Kinect skeletons of UI-PRMD as
    .npz."""

    movement: str | None = None
    """The captured movement, such as sit-to-stand, deep-squat or shoulder-abduction, or the name of a clip; by default
    drawn at random."""

    equipment: Equipment | None = None
    """The equipment that the patient uses; by default that of the preset. Parallel bars of the preset 'rehabilitation'
    come with a chest pad and straps."""

    passer_by: bool = False
    """Add a person who walks between a camera and the patient."""

    speed: Speed | None = None
    """How fast the patient moves; by default as in the preset."""

    height: Annotated[float | None, positive(TALLEST_M)] = None
    """The patient's height in metres; by default drawn at random."""

    build: Build | None = None
    """The patient's body. ordinary: like the bodies that the tracker knows. varied: length and thickness of every
    segment differ independently, in shoes or barefoot. wasted-legs: varied, with thin legs and strong arms. heavy:
    varied, with a belly. child: 1.0 to 1.5 m tall."""

    brace: Annotated[tuple[BraceName, ...] | None, Parameter(consume_multiple=True)] = None
    """Segments of the patient that a stiff orthosis covers."""

    missing: Annotated[tuple[str, ...] | None, Parameter(consume_multiple=True)] = None
    """Limbs that the patient lacks, such as shank_left; recording.json states them."""

    body: Path | None = None
    """A file with another body to use in place of a random one: an .npz as described in docs/simulate.md."""

    scene: Scene | None = None
    """A situation in which trackers lose the patient. enters-late: the therapists are there first, the patient walks in
    later. leaves: the patient walks out and comes back. hidden: a curtain hides the patient from all cameras for two
    seconds. sits: the patient sits down or stands up. Scenes with a walking or seated patient have no standing frame.
    Walking out of view and back needs 12 seconds, or 15 with wide-angle sensors or cameras on all sides."""

    pose_unknown: bool = False
    """Leave the camera poses out of the recording, so that they must be estimated."""

    rough_recorder: bool = False
    """Record as imperfectly as real recorders do: time stamps vary by 4 ms, and 3 of 100 depth images are replaced by
    the image before. All cameras but the first also lose 3 of 100 images, and their clocks drift and differ from the
    first camera's by up to 2 s."""

    session: SessionOptions = field(default_factory=SessionOptions)

    def _body(self) -> OtherBody | None:
        """Return the options that change the patient's body (build, braces, missing limbs, file); None if none of them
        is given.
        """
        from anchorpose.settings import sentence_of
        from anchorpose.simulate.bodies import OtherBody

        given = {"build": self.build, "braces": self.brace, "missing": self.missing, "file": self.body}
        chosen: dict[str, Any] = {name: value for name, value in given.items() if value is not None}
        try:
            return OtherBody(**chosen) if chosen else None
        except ValueError as problem:
            raise AnchorposeError(f"{sentence_of(problem)}; see 'anchorpose simulate --help'") from problem

    def settings(self) -> SimulationConfig:
        """Return the preset, changed by the given options; raises AnchorposeError if options contradict each other."""
        from anchorpose.settings import sentence_of
        from anchorpose.simulate import config as presets
        from anchorpose.simulate.sessions.plan import SessionConfig
        from anchorpose.simulate.sessions.preset import stimulation

        names = ("cameras", "lens", "therapists", "motions", "speed")
        given: dict[str, Any] = {name: getattr(self, name) for name in names}
        one_each = self.sensor is not None and len(self.sensor) > 1
        given |= {"sensors": self.sensor} if one_each else {"sensor": self.sensor[0] if self.sensor else None}
        given |= {"equipment": self.equipment, "passers_by": 1 if self.passer_by else None}
        given |= {"body": self._body(), "height_m": self.height, "pose_known": False if self.pose_unknown else None}
        seconds = DEFAULT_S if self.seconds is None else self.seconds
        try:
            self._refuse_unused()
            if self.preset == "stimulation":
                settings = stimulation(self.seed, SessionConfig(**self.session.given), self.fps)
            elif self.preset == "holes":
                settings = presets.holes(self.seed, self.hole_radius or DEFAULT_HOLE_M, seconds, self.fps)
            elif self.preset == "room":
                settings = presets.room(self.seed, seconds, self.fps, self.movements)
            else:
                preset = presets.single if self.preset == "single" else presets.clinic
                settings = preset(self.seed, seconds, self.fps)
            chosen = {name: value for name, value in given.items() if value is not None}
            if self.preset == "room" and (chosen.keys() - {"pose_known"} or self.scene):
                raise ValueError("the preset room draws all this from its seed; choose another seed instead")
            settings = replace(settings, **chosen)
            settings = self._captured(settings)
            settings = presets.scene(settings, self.scene) if self.scene else settings
            return presets.rough_recorder(settings) if self.rough_recorder else settings
        except ValueError as error:
            raise AnchorposeError(f"{sentence_of(error)}.") from None

    def _refuse_unused(self) -> None:
        """Raise ValueError if an option is given that the preset does not use."""
        session, paced = self.preset == "stimulation", self.preset in ("clinic", "holes", "single")
        if self.session.given and not session:
            raise ValueError("trials belong to the preset stimulation; add --preset stimulation")
        if self.seconds is not None and session:
            raise ValueError("a session lasts as long as its trials; give --trials and --trial-seconds, not --seconds")
        if self.hole_radius is not None and self.preset != "holes":
            raise ValueError("a hole belongs to the preset holes; add --preset holes")
        if self.speed is not None and not paced:
            raise ValueError("--speed belongs to the presets clinic, holes and single; leave it out")

    def _captured(self, settings: SimulationConfig) -> SimulationConfig:
        """Return the configuration, with a captured movement if the preset needs one.

        Raises AnchorposeError if the file of movements is missing, or if it is given for a preset without captured
        movements.
        """
        from anchorpose.simulate.config import rehabilitation

        if self.preset != "rehabilitation":
            if self.preset == "room" and self.movements is not None and not self.movements.is_file():
                raise InputError(self.movements, "is not there", "give the file with the skeletons of UI-PRMD as .npz")
            if (self.movements is not None and self.preset != "room") or self.movement is not None:
                raise AnchorposeError(
                    "Captured movements belong to the preset rehabilitation; add --preset rehabilitation."
                )
            return settings
        if self.movements is None:
            raise AnchorposeError(
                "The preset rehabilitation needs captured movements; give their file with --movements."
            )
        equipment = self.equipment or "parallel-bars"
        return rehabilitation(settings, self.movements, self.movement, equipment, settings.passers_by)


def simulate(out: Path, /, *, options: SimulateOptions | None = None, defaults: SettingsFile | None = None) -> None:
    """Make a recording of a simulated patient whose true joints are known, for tests and first steps.

    Parameters
    ----------
    out
        The folder to write: a recording in recording/ and the true joints in truth/truth.npz.
    """
    from anchorpose.results.folder import naming_place
    from anchorpose.simulate.write import simulate_recording

    settings = (options or SimulateOptions()).settings()
    with naming_place(out), progress_bar("Simulating") as progress:
        simulate_recording(out, settings, progress)
    say(f"The recording is {out / 'recording'}, its true joints are {out / 'truth' / 'truth.npz'}.")
