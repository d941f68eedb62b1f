"""Draw all people and objects in the room at random from one seed, and compute their places at any time."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from anchorpose.body.kinematics import missing_joints
from anchorpose.camera import Camera
from anchorpose.recording.equipment import EquipmentModel, EquipmentPart
from anchorpose.simulate.captured_patient import draw_captured
from anchorpose.simulate.config import SimulationConfig
from anchorpose.simulate.equip import fit_around, fit_held
from anchorpose.simulate.patient import Actor, draw_patient
from anchorpose.simulate.person import Person, draw_patient_person
from anchorpose.simulate.render import PATIENT, Figure
from anchorpose.simulate.retarget import CapturedActor
from anchorpose.simulate.rooms.plan import RoomConfig
from anchorpose.simulate.rooms.scene import RoomScene, draw_scene
from anchorpose.simulate.sensor import SENSORS, intrinsics_of
from anchorpose.simulate.sessions.patient import draw_session_patient
from anchorpose.simulate.sessions.plan import PlannedTrial, SessionConfig, draw_plan
from anchorpose.simulate.sessions.therapists import draw_session_therapists
from anchorpose.simulate.therapist import Therapist, draw_passer_by, draw_therapists
from anchorpose.simulate.ways_out import ways_out

STREAMS = (
    "patient",
    "programme",
    "therapists",
    "room",
    "cameras",
    "holes",
    "sensor",
    "drops",
    "doubles",
    "stamps",
    "movement",
    "passers",
    "session",
)
CAMERA_NAMES = ("front", "left", "right", "behind")
# rad, direction from the patient to each camera: 0 = front, + = left
AZIMUTH_RAD = (0.0, np.radians(57.0), np.radians(-57.0), np.pi)
AZIMUTH_SPREAD_RAD = (0.08, 0.2, 0.2, 0.3)  # rad, maximum random deviation of each camera from ``AZIMUTH_RAD``
WALL_M = 2.7  # m, height of the walls

Programme = Callable[[np.random.Generator, Person], Actor]
"""Function that draws a person's movements with the random numbers of a generator."""


@dataclass(frozen=True, slots=True, eq=False)
class Clinic:
    """The contents of one recording: people, room and cameras."""

    config: SimulationConfig
    cameras: tuple[Camera, ...]
    room: np.ndarray  # (n, 3, 3) triangles of floor and walls; in a cluttered room, of everything that never moves
    equipment: EquipmentModel | None
    patient: Actor | CapturedActor
    therapists: tuple[Therapist, ...]  # the therapists, followed by the people who pass by
    scene: RoomScene | None = None  # content of a cluttered room (``rooms``); None for a plain training room
    plan: tuple[PlannedTrial, ...] = ()  # trials of a session; empty without a session

    @property
    def parts(self) -> tuple[EquipmentPart, ...]:
        """Return the parts of the equipment; empty without equipment."""
        return () if self.equipment is None else self.equipment.parts

    def pushed_m(self, time_s: float) -> np.ndarray:
        """Return the displacement (3,) of the equipment at a time; 0 before it is pushed."""
        at_s, (x, z) = self.config.equipment_moves_at_s, self.config.equipment_shift_m
        return np.array([x, 0.0, z]) if at_s is not None and time_s >= at_s else np.zeros(3)

    def true_times_s(self, camera: int) -> np.ndarray:
        """Return the true times (t,), s, at which a camera takes its images.

        The time stamps of the images differ from these times: a stamp is the epoch of the camera's clock, plus frame /
        fps, plus a random error.
        """
        stamps = np.arange(self.config.frames) / self.config.fps
        late = self.config.clock_late_s[camera] if self.config.clock_late_s else 0.0
        drift = self.config.clock_drift[camera] if self.config.clock_drift else 0.0
        return stamps + late + drift * stamps

    def act(self, times_s: np.ndarray) -> Performance:
        """Return the movements of all people at times (t,)."""
        patient = self.patient.bones(times_s)
        others = tuple(therapist.bones(times_s, self.patient, patient) for therapist in self.therapists)
        return Performance(self, times_s, (patient, *others))


@dataclass(frozen=True, slots=True, eq=False)
class Performance:
    """The movements of all people at given times."""

    clinic: Clinic
    times_s: np.ndarray  # (t,) times of the images
    bones: tuple[np.ndarray, ...]  # per person, the patient first: (t, b, 4, 4) T_world_rest of the bones

    def figures(self, frame: int) -> tuple[Figure, ...]:
        """Return the dressed skin of all people in one frame. While the patient is away, the patient's figure has no
        triangles.
        """
        nobody = self.away[frame]
        people = [self.clinic.patient.person, *(therapist.actor.person for therapist in self.clinic.therapists)]
        return tuple(
            Figure(
                skin_m=person.skin(bones[frame], float(self.times_s[frame])),
                faces=person.body.asset.faces[: 0 if nobody and index == 0 else None],
                face_part=face_parts(person),
                label=PATIENT + index,
            )
            for index, (person, bones) in enumerate(zip(people, self.bones, strict=True))
        )

    def joints_m(self) -> np.ndarray:
        """Return (t, 21, 3) the patient's joints; NaN while the patient is away, and for missing limbs."""
        body = self.clinic.patient.person.body
        joints = np.array([body.joints(bones) for bones in self.bones[0]])
        joints[self.away] = np.nan
        joints[:, missing_joints(body.asset, self.clinic.config.body.missing)] = np.nan
        return joints

    @property
    def away(self) -> np.ndarray:
        """Return (t,) bool: whether the patient is away, out of the view of all cameras (``away_s`` of the
        configuration).
        """
        spans = self.clinic.config.away_s
        return np.array([any(a <= time_s < b for a, b in spans) for time_s in self.times_s.tolist()], dtype=bool)

    def held_joints(self) -> np.ndarray:
        """Return (t, n, 2) int: the patient's joint that each hand of each therapist holds, -1 = no joint. All values
        are -1 in frames in which the patient is away.
        """
        patient, therapists = self.clinic.patient, self.clinic.therapists
        held = np.full((len(self.times_s), len(therapists), 2), -1)
        for index, therapist in enumerate(therapists):
            held[:, index] = therapist.held_joints(self.times_s, patient, self.bones[0], self.bones[1 + index])
        held[self.away] = -1
        return held


def random_stream(config: SimulationConfig, name: str, *keys: int) -> np.random.Generator:
    """Return the random generator for one purpose: ``name``, one of ``STREAMS``, with ``keys`` such as a camera's
    index.

    Each purpose has a generator of its own, so a change of one part of the simulation does not change the other parts.
    """
    return np.random.default_rng(np.random.SeedSequence(config.seed, spawn_key=(STREAMS.index(name), *keys)))


def draw_clinic(config: SimulationConfig, programme: Programme | None = None) -> Clinic:
    """Draw people, room and cameras from ``config.seed``. programme: function that draws the patient's movements; None
    = the movements that ``config`` states.
    """
    if config.room is not None:
        return _in_room(config, config.room)
    if config.session is not None:
        return _session(config, config.session)
    person = draw_patient_person(random_stream(config, "patient"), config)
    scenery = random_stream(config, "room")
    cameras = place_cameras(random_stream(config, "cameras"), config)
    room = room_triangles(random_stream(config, "room", 1), config.cameras == 4)
    patient: Actor | CapturedActor
    if config.movement_file is None:
        held = fit_held(scenery, config, person)
        drawn = random_stream(config, "programme")
        exits_m = ways_out(cameras, room) if config.away_s else None
        patient = draw_patient(drawn, config, person, held, exits_m) if programme is None else programme(drawn, person)
    else:
        held, patient = None, draw_captured(random_stream(config, "movement"), config, person)
    parts = fit_around(scenery, config, patient, held)
    others = draw_therapists(random_stream(config, "therapists"), config, patient)
    walkers = random_stream(config, "passers")
    return Clinic(
        config=config,
        cameras=cameras,
        room=room,
        equipment=EquipmentModel(parts) if parts else None,
        patient=patient,
        therapists=(*others, *(draw_passer_by(walkers, config, cameras) for _ in range(config.passers_by))),
    )


def _session(config: SimulationConfig, session: SessionConfig) -> Clinic:
    """Return the clinic of a session: a patient who does the session's trials, and therapists who help in some
    trials.
    """
    person, scenery = draw_patient_person(random_stream(config, "patient"), config), random_stream(config, "room")
    plan, held = draw_plan(random_stream(config, "session"), session), fit_held(scenery, config, person)
    patient = draw_session_patient(random_stream(config, "programme"), person, held, plan)
    parts, cameras = fit_around(scenery, config, patient, held), place_cameras(random_stream(config, "cameras"), config)
    helping = draw_session_therapists(random_stream(config, "therapists"), config, patient, plan)
    walkers = random_stream(config, "passers")
    return Clinic(
        config=config,
        cameras=cameras,
        room=room_triangles(random_stream(config, "room", 1), config.cameras == 4),
        equipment=EquipmentModel(parts) if parts else None,
        patient=patient,
        therapists=(*helping, *(draw_passer_by(walkers, config, cameras) for _ in range(config.passers_by))),
        plan=plan,
    )


def _in_room(config: SimulationConfig, room: RoomConfig) -> Clinic:
    scene = draw_scene(config, room)
    return Clinic(
        config=config,
        cameras=(scene.camera,),
        room=scene.triangles,
        equipment=None,
        patient=scene.patient,
        therapists=scene.people,
        scene=scene,
    )


def place_cameras(rng: np.random.Generator, config: SimulationConfig) -> tuple[Camera, ...]:
    """Place cameras on tripods around the patient, who stands at the origin and faces +X."""
    cameras = []
    for index in range(config.cameras):
        spec = SENSORS[config.sensor_of(index)]
        azimuth = AZIMUTH_RAD[index] + rng.uniform(-1.0, 1.0) * AZIMUTH_SPREAD_RAD[index]
        distance_m = rng.uniform(2.25, 2.85)
        position = np.array([distance_m * np.cos(azimuth), rng.uniform(1.1, 1.5), -distance_m * np.sin(azimuth)])
        target = np.array([rng.uniform(-0.1, 0.1), rng.uniform(0.82, 0.95), rng.uniform(-0.08, 0.08)])
        cameras.append(
            Camera(
                name=CAMERA_NAMES[index],
                width=spec.width,
                height=spec.height,
                depth_scale=0.001,
                intrinsics=intrinsics_of(spec, config.lens),
                T_world_camera=look_at(position, target),
            )
        )
    return tuple(cameras)


def look_at(position_m: np.ndarray, target_m: np.ndarray) -> np.ndarray:
    """Return T_world_camera (4, 4) of a camera at ``position_m``, without roll, that looks at ``target_m``."""
    away = (target_m - position_m) / np.linalg.norm(target_m - position_m)
    right = np.cross(away, [0.0, 1.0, 0.0])
    right /= np.linalg.norm(right)
    T_world_camera = np.eye(4)
    T_world_camera[:3, :3] = np.stack([right, np.cross(away, right), away], axis=1)
    T_world_camera[:3, 3] = position_m
    return T_world_camera


def room_triangles(rng: np.random.Generator, camera_behind: bool) -> np.ndarray:
    """Return triangles (n, 3, 3) of the floor and four walls. No camera sees the ceiling, so it is left out."""
    back = -rng.uniform(3.1, 3.5) if camera_behind else -rng.uniform(1.7, 2.4)
    left, right, front = -rng.uniform(2.6, 3.2), rng.uniform(2.6, 3.2), rng.uniform(3.2, 3.8)
    quads = [
        [[back, 0, left], [front, 0, left], [front, 0, right], [back, 0, right]],
        [[back, 0, left], [back, 0, right], [back, WALL_M, right], [back, WALL_M, left]],
        [[back, 0, left], [back, WALL_M, left], [front, WALL_M, left], [front, 0, left]],
        [[back, 0, right], [front, 0, right], [front, WALL_M, right], [back, WALL_M, right]],
        [[front, 0, left], [front, WALL_M, left], [front, WALL_M, right], [front, 0, right]],
    ]
    return np.array([[q[0], q[i], q[i + 1]] for q in quads for i in (1, 2)])


def face_parts(person: Person) -> np.ndarray:
    """Return (f,) uint8: for each triangle of the skin, 1 + index of the bone that mostly moves its first corner."""
    asset = person.body.asset
    return (asset.main_bone()[asset.faces[:, 0]] + 1).astype(np.uint8)
