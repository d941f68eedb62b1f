"""Track frame by frame: accept depth images as they arrive, and return the joints in each frame.

As in ``anchorpose live``, tracking starts after the first part of the session (``START_S`` seconds by default). From
the images of this part, the program determines clocks and camera poses, the room, the patient and the patient's body.
Until tracking starts, all images are kept in a temporary folder.
"""

from __future__ import annotations

import shutil
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from tempfile import mkdtemp
from types import TracebackType
from typing import Final

import numpy as np

from anchorpose.api.arrays import Setup, grey_of, require_known
from anchorpose.camera import Camera, places_of
from anchorpose.errors import AnchorposeError
from anchorpose.isolation.other_place import without_other_places
from anchorpose.joints import JOINT_NAMES, STATE_CODE, JointState
from anchorpose.live.first_seconds import LiveOptions, Prepared, latest_good, learn_in, new_room
from anchorpose.live.recorder import leave_out_cameras
from anchorpose.recording.depth_image import frame_set_of_greys
from anchorpose.recording.document import read_document
from anchorpose.recording.reader import open_recording, read_frame
from anchorpose.recording.recording import Subject
from anchorpose.recording.recording_file import RECORDING_FILE, RecordingDocument
from anchorpose.results.joint_angles import joint_angles
from anchorpose.results.tables import AngleTable, JointTable
from anchorpose.sources.plan import CameraWriter
from anchorpose.threads import one_thread
from anchorpose.tracker.config import TrackConfig
from anchorpose.tracker.estimate import Estimate
from anchorpose.tracker.following import Follower

# s; default duration of the first part of a session, from which the body is learnt, as in ``anchorpose live``: in this
# time, a patient moves enough to locate the joints
START_S: Final = 6.0


@dataclass(frozen=True, eq=False)
class Pose:
    """The patient in one frame.

    joints_m (21, 3): in the order of ``JOINT_NAMES``, metres in the world (X forward, Y up, Z to the patient's right),
    NaN where a joint is lost. sigma_m (21,): standard deviation of each joint's position along each axis, metres.
    states: the state of each joint: observed, hidden (and by what), outside of the image, or lost.
    """

    frame: int
    time_s: float
    joints_m: np.ndarray
    sigma_m: np.ndarray
    states: tuple[JointState, ...]

    def __getitem__(self, joint: str) -> np.ndarray:
        """Return a joint's position (3,) by its name; raises KeyError for an unknown name."""
        if joint not in JOINT_NAMES:
            raise KeyError(joint)
        return np.asarray(self.joints_m[JOINT_NAMES.index(joint)])

    @property
    def angles_deg(self) -> dict[str, float]:
        """Return the value of each angle in docs/angles.md by the angle's name, degrees; NaN if the pose does not
        determine the angle.
        """
        return dict(zip(self._angles.names, self._angles.degrees[0].tolist(), strict=True))

    @property
    def angles_sigma_deg(self) -> dict[str, float]:
        """Return the standard deviation of each angle by the angle's name, degrees."""
        return dict(zip(self._angles.names, self._angles.sigma_deg[0].tolist(), strict=True))

    @cached_property
    def _angles(self) -> AngleTable:
        codes = np.array([[STATE_CODE[state] for state in self.states]], np.int8)
        one = JointTable(
            np.array([self.frame], np.int32), np.array([self.time_s]), self.joints_m[None], codes, self.sigma_m[None]
        )
        return joint_angles(one)


class Tracker:
    """A tracker that finds the patient in successive depth images, and then gives the pose in each frame.

    why: the reason why the last ``step`` returned None, in words; empty if it returned a pose. Use a tracker in a
    ``with`` block, or call ``close``: the first images are kept in a temporary folder until the patient is found.
    """

    why: str

    def __init__(
        self,
        cameras: Sequence[Camera] | Path | str,
        *,
        subject: Subject | None = None,
        equipment: Path | str | None = None,
        empty_room_m: Mapping[str, np.ndarray] | None = None,
        start_s: float = START_S,
        config: TrackConfig | None = None,
    ) -> None:
        """Make a tracker. cameras: the cameras whose images will be given, or a recording folder whose cameras, patient
        and equipment are used.

        subject, equipment (an equipment.json) and empty_room_m: knowledge about patient and room, as in ``Setup``.
        start_s: duration in s of the first part of the session, from which the body is learnt. Raises InputError if an
        argument is wrong.
        """
        known = _setup_of(Path(cameras)) if isinstance(cameras, Path | str) else Setup(cameras=tuple(cameras))
        self._setup = replace(
            known,
            subject=subject or known.subject,
            equipment=known.equipment if equipment is None else equipment,
            empty_room_m=empty_room_m or known.empty_room_m,
        )
        self._options = LiveOptions(config=config or TrackConfig(), start_s=start_s)
        self.why = "no image was given yet"
        self._frame, self._last_s, self._closed = -1, -np.inf, False
        self._prepared: Prepared | None = None
        self._follower: Follower | None = None
        self._begin()

    def __enter__(self) -> Tracker:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Remove the temporary folder. After this call, ``step`` raises AnchorposeError."""
        self._closed = True
        self._stack.close()

    @property
    def height_m(self) -> float | None:
        """Return the patient's standing height by the learnt body; None until the body is learnt."""
        if self._prepared is None:
            return None
        from anchorpose.body.shape_prior import standing_height
        from anchorpose.body.skin_points import body_points

        return standing_height(body_points().asset, self._prepared.learnt.shape)[0]

    def step(self, depth_m: Mapping[str, np.ndarray], time_s: float) -> Pose | None:
        """Return the pose in the next frame; None while the patient is not found, or is lost (``why`` gives the
        reason).

        depth_m: for each camera name, a depth image (height, width), metres along the optical axis; 0, NaN and infinite
        mean that the pixel has no reading. A camera that is left out has no image in this frame. time_s: time of the
        frame, later than the time of the previous frame. The call that completes the first part of the session
        (``start_s`` seconds) also learns the patient's body, so it takes much longer than other calls. Raises
        AnchorposeError if an argument does not fit the cameras or the previous frames, or if the tracker is closed.
        """
        if self._closed:
            raise AnchorposeError("This Tracker is closed; make a new Tracker.")
        if not time_s > self._last_s:
            raise AnchorposeError(f"The frame at {time_s:g} s is not later than the one before; give increasing times.")
        require_known(depth_m, self._setup.cameras)
        greys = [
            None if depth_m.get(camera.name) is None else grey_of(depth_m[camera.name], camera)
            for camera in self._setup.cameras
        ]
        self._last_s, self._frame = time_s, self._frame + 1
        with one_thread():
            estimate = (
                self._look(greys, time_s) if self._follower is None else self._follow(self._follower, greys, time_s)
            )
        return self._answer(estimate)

    def _begin(self) -> None:
        """Start collecting the frames from which the body is learnt, over ``start_s`` seconds. The next frame that
        ``step`` receives is the first of these frames.
        """
        self._began_s = np.nan
        with ExitStack() as stack:
            self._folder = Path(mkdtemp(prefix="anchorpose-"))
            stack.callback(shutil.rmtree, self._folder, ignore_errors=True)
            self._writers: list[CameraWriter] = stack.enter_context(self._setup.writers(self._folder))
            self._stack = stack.pop_all()

    def _look(self, greys: Sequence[np.ndarray | None], time_s: float) -> Estimate | None:
        """Store a frame for learning, and return None as long as the stored frames cover less than ``start_s`` seconds.
        Then learn the body from the stored frames and return the newest estimate; if the patient is not found in them,
        return None and start collecting again.
        """
        self._began_s = time_s if np.isnan(self._began_s) else self._began_s
        for writer, grey in zip(self._writers, greys, strict=True):
            if grey is not None:
                writer.write(time_s, grey, self._frame)
        seen_s = time_s - self._began_s
        if seen_s < self._options.start_s:
            self.why = f"{seen_s:.1f} of the first {self._options.start_s:g} s were looked at"
            return None
        try:
            return self._learn()
        finally:
            self._stack.close()
            if self._follower is None:
                self._begin()

    def _learn(self) -> Estimate | None:
        """Learn the room, the patient and the body from the stored frames; return the newest estimate, or None if no
        patient is found (``why`` gives the reason).
        """
        seen = [writer.folder.name for writer in self._writers if writer.written]
        if not seen:
            self.why = "no camera had a depth image in the first seconds"
            return None
        leave_out_cameras(self._folder / RECORDING_FILE, seen)
        inputs, room = new_room(open_recording(self._folder), self._options)
        self._prepared = learn_in(room, inputs)
        if self._prepared is None:
            self.why = room.why_nobody or "no human body fits whoever is seen"
            return None
        return self._catch_up(self._prepared)

    def _catch_up(self, prepared: Prepared) -> Estimate | None:
        """Track the stored frames, beginning with the latest frame that shows the patient well; return the newest
        estimate.
        """
        run = replace(prepared.run, config=self._options.live(prepared.run.config))
        initial, recording = latest_good(run.room.initial_frames), run.room.recording
        self._follower, newest = Follower(run, initial.choice, prepared.learnt.shape), list[Estimate]()
        for position in range(initial.frame, len(recording.streams[0].files)):
            frame_set = without_other_places(read_frame(recording, position), run.room.scenes)
            newest = list(self._follower.step(frame_set))
        return newest[-1] if newest else None

    def _follow(self, follower: Follower, greys: Sequence[np.ndarray | None], time_s: float) -> Estimate | None:
        room = follower.run.room
        cameras = room.recording.cameras  # leaves out cameras that gave no usable image in the first seconds
        own = [greys[place] for place in places_of(cameras, self._setup.cameras)]
        frame_set = frame_set_of_greys(self._frame, time_s, cameras, own, [time_s] * len(cameras))
        newest = list(follower.step(without_other_places(frame_set, room.scenes)))
        return newest[-1] if newest else None

    def _answer(self, estimate: Estimate | None) -> Pose | None:
        if estimate is None:
            return None
        if all(state is JointState.LOST for state in estimate.states):
            self.why = estimate.why_lost or "the patient is not seen"
            return None
        self.why, frame_set = "", estimate.frame_set
        return Pose(frame_set.frame, frame_set.time_s, estimate.joints_m, estimate.sigma_m, estimate.states)


def _setup_of(folder: Path) -> Setup:
    """Read what a recording states about its cameras, patient and room."""
    recording = open_recording(folder)
    rooms = {
        camera.name: room
        for camera, room in zip(recording.cameras, recording.backgrounds_m, strict=True)
        if room is not None
    }
    file = read_document(folder / RECORDING_FILE, RecordingDocument).equipment
    equipment = None if file is None else folder / file
    return Setup(cameras=recording.cameras, subject=recording.subject, equipment=equipment, empty_room_m=rooms)
