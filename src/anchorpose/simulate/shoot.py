"""Each camera's depth images, without error and as the sensor reads them, and which of them the recorder keeps."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from anchorpose.camera import Camera, transform_points
from anchorpose.simulate.clinic import Clinic, Performance, random_stream
from anchorpose.simulate.render import PATIENT, Figure, TrueImage, draw_figures, render_still
from anchorpose.simulate.seen import seen_shares, share_behind
from anchorpose.simulate.sensor import SENSORS, draw_wiggle, sense

JITTER_LIMIT = 0.4  # of a period: beyond half of one, stamps could change places
JITTER_SPREADS = 2.0  # where the normal distribution of the jitter is cut
CURTAIN_M, CURTAIN_HALF_WIDTH_M, CURTAIN_HEIGHT_M = 1.0, 1.3, 2.2  # before the patient: more than an arm's length
BACKGROUND_FRAMES = 9  # the empty room is the median of so many images


@dataclass(frozen=True, slots=True, eq=False)
class Shot:
    """One moment: the error-free image and the reading (height, width) uint16 millimetres of each camera."""

    figures: tuple[Figure, ...]  # as the first camera saw them
    images: tuple[TrueImage, ...]
    depths_mm: tuple[np.ndarray, ...]
    seen_share: np.ndarray  # (21, cameras), see ``seen_shares``
    behind_passers: float  # of what a camera would see of the patient, the largest share that people passing by hide


@dataclass(frozen=True, slots=True, eq=False)
class Studio:
    """A clinic with its cameras set up: the empty room and the steady error of each."""

    clinic: Clinic
    stills: tuple[TrueImage, ...]
    wiggles_m: tuple[np.ndarray, ...]
    performances: tuple[Performance, ...]  # one per camera; the same object where clocks agree
    in_hole: np.ndarray  # (t,) bool
    records: tuple[Record, ...]  # one per camera: what is written of its images
    stills_after: tuple[TrueImage, ...]  # one per camera: the empty room once the equipment has been moved
    stills_curtained: tuple[TrueImage, ...]  # one per camera: the empty room behind a curtain

    def shoot(self, frame: int) -> Shot:
        """All cameras' images with one number."""
        clinic, spec = self.clinic, SENSORS[self.clinic.config.sensor]
        figures = {id(p): p.figures(frame) for p in self.performances}
        images, depths, seen, behind = [], [], [], []
        patient = clinic.patient.person
        for index, camera in enumerate(clinic.cameras):
            performance = self.performances[index]
            moves_at_s = clinic.config.equipment_moves_at_s
            moved = moves_at_s is not None and performance.times_s[frame] >= moves_at_s
            stills = self.stills_after if moved else self.stills
            stills = self.stills_curtained if _curtain_hangs(clinic, float(performance.times_s[frame])) else stills
            image = draw_figures(camera, stills[index], figures[id(performance)])
            rng = random_stream(clinic.config, "sensor", index, frame)
            images.append(image)
            depths.append(sense(rng, spec, image.depth_m, image.cosine, self.wiggles_m[index]))
            people = figures[id(performance)]
            behind.append(share_behind(camera, stills[index], people, clinic.config.passers_by, image))
            seen.append(seen_shares(patient, performance.bones[0][frame], people[0].skin_m, camera, image))
        if self.in_hole[frame]:
            depths = _with_hole(clinic, images, depths)
        return Shot(
            figures[id(self.performances[0])], tuple(images), tuple(depths), np.stack(seen, axis=1), max(behind)
        )

    def background_mm(self, index: int) -> np.ndarray:
        """(height, width) uint16: the empty room with its equipment, as a recorder would average it."""
        config, still = self.clinic.config, self.stills[index]
        empty = [
            sense(
                random_stream(config, "sensor", index, config.frames + number),
                SENSORS[config.sensor],
                still.depth_m,
                still.cosine,
                self.wiggles_m[index],
            )
            for number in range(BACKGROUND_FRAMES)
        ]
        return np.median(empty, axis=0).astype(np.uint16)


def set_up(clinic: Clinic) -> Studio:
    """Render the empty room and compute everybody's movements."""
    config = clinic.config
    equipment = equipment_triangles(clinic, moved=False)
    performances: list[Performance] = []
    for index in range(config.cameras):
        times_s = clinic.true_times_s(index)
        same = [p for p in performances if np.array_equal(p.times_s, times_s)]
        performances.append(same[0] if same else clinic.act(times_s))
    spec = SENSORS[config.sensor]
    stills = tuple(render_still(camera, clinic.room, equipment) for camera in clinic.cameras)
    elsewhere = equipment_triangles(clinic, moved=True)
    return Studio(
        clinic=clinic,
        stills=stills,
        stills_after=stills
        if config.equipment_moves_at_s is None
        else tuple(render_still(camera, clinic.room, elsewhere) for camera in clinic.cameras),
        stills_curtained=stills
        if config.curtain_s is None
        else tuple(
            render_still(camera, np.concatenate([clinic.room, curtain_triangles(camera)]), equipment)
            for camera in clinic.cameras
        ),
        wiggles_m=tuple(draw_wiggle(random_stream(config, "sensor", index), spec) for index in range(config.cameras)),
        performances=tuple(performances),
        in_hole=_draw_hole_frames(clinic),
        records=tuple(draw_record(clinic, index) for index in range(config.cameras)),
    )


def equipment_triangles(clinic: Clinic, moved: bool) -> np.ndarray:
    """(n, 3, 3) world metres, before or after somebody pushed it: turned about its middle, then shifted."""
    if clinic.equipment is None:
        return np.zeros((0, 3, 3))
    vertices, faces = clinic.equipment.triangles()
    if moved:
        config, middle = clinic.config, (vertices.min(axis=0) + vertices.max(axis=0)) / 2.0
        cos, sin = np.cos(config.equipment_turn_rad), np.sin(config.equipment_turn_rad)
        turn = np.array([[cos, 0.0, sin], [0.0, 1.0, 0.0], [-sin, 0.0, cos]])
        vertices = (vertices - middle) @ turn.T + middle
        x, z = config.equipment_shift_m
        vertices = vertices + np.array([x, 0.0, z])
    triangles: np.ndarray = vertices[faces]
    return triangles


def _curtain_hangs(clinic: Clinic, time_s: float) -> bool:
    span = clinic.config.curtain_s
    return span is not None and span[0] <= time_s < span[1]


def curtain_triangles(camera: Camera) -> np.ndarray:
    """(2, 3, 3) world metres: a curtain from the floor up that hides the patient's place from one camera."""
    towards = camera.position_m * [1.0, 0.0, 1.0]
    towards /= np.linalg.norm(towards)
    middle, aside = CURTAIN_M * towards, CURTAIN_HALF_WIDTH_M * np.cross(towards, [0.0, 1.0, 0.0])
    low, high = [0.0, 0.01, 0.0], [0.0, CURTAIN_HEIGHT_M, 0.0]
    corners = [middle - aside + low, middle + aside + low, middle + aside + high, middle - aside + high]
    return np.array([[corners[0], corners[1], corners[2]], [corners[0], corners[2], corners[3]]])


def body_centre_m(cameras: tuple[Camera, ...], images: list[TrueImage]) -> np.ndarray | None:
    """(3,) mean of the patient's visible points of all cameras, world frame; None where there are none."""
    seen = [
        transform_points(camera.require_pose(), camera.back_project(image.depth_m)[image.label == PATIENT])
        for camera, image in zip(cameras, images, strict=True)
    ]
    points_world = np.concatenate(seen)
    return points_world.mean(axis=0) if len(points_world) else None


def _with_hole(clinic: Clinic, images: list[TrueImage], depths_mm: list[np.ndarray]) -> list[np.ndarray]:
    """The paper's hole (Section V): every reading within a radius of the body's centre is gone."""
    centre_m = body_centre_m(clinic.cameras, images)
    if centre_m is None:
        return depths_mm
    holed = []
    for camera, depth in zip(clinic.cameras, depths_mm, strict=True):
        points = camera.back_project(depth * camera.depth_scale)
        distance_m = np.linalg.norm(transform_points(camera.require_pose(), points) - centre_m, axis=2)
        holed.append(np.where(distance_m < clinic.config.hole_radius_m, 0, depth).astype(np.uint16))
    return holed


def _draw_hole_frames(clinic: Clinic) -> np.ndarray:
    config = clinic.config
    if config.hole_radius_m == 0:
        return np.zeros(config.frames, dtype=bool)
    return random_stream(config, "holes").random(config.frames) < config.hole_share


@dataclass(frozen=True, slots=True, eq=False)
class Record:
    """One camera's files by frame number; each (t,).

    kept: bool, the image is on the disk; shown: int64, the number of the image that the file holds (its own or, where
    doubled, an earlier one); stamp_s: float64, what timestamps.csv says; taken_s: float64, when that image was taken.
    """

    kept: np.ndarray
    shown: np.ndarray
    stamp_s: np.ndarray
    taken_s: np.ndarray


def draw_record(clinic: Clinic, index: int) -> Record:
    """What camera ``index`` writes. The first camera keeps all its images: its frames number the truth."""
    config = clinic.config
    nominal_s, taken_s = np.arange(config.frames) / config.fps, clinic.true_times_s(index)
    kept = _kept(clinic, index, nominal_s)
    shown = np.arange(config.frames)
    doubled = (random_stream(config, "doubles", index).random(config.frames) < config.doubled_share) & kept
    before = np.maximum.accumulate(np.where(kept, shown, -1))  # the last image on the disk, this one included
    for frame in np.flatnonzero(doubled):
        if frame > 0 and before[frame - 1] >= 0:
            shown[frame] = shown[before[frame - 1]]
    epoch_s = config.clock_epoch_s[index] if config.clock_epoch_s else 0.0
    stamp_s = nominal_s + epoch_s + _jitter_s(clinic, index)
    return Record(kept, shown, stamp_s, taken_s[shown])


def _kept(clinic: Clinic, index: int, nominal_s: np.ndarray) -> np.ndarray:
    config = clinic.config
    kept = random_stream(config, "drops", index).random(config.frames) >= config.dropped_share
    starts = config.starts_late_s[index] if config.starts_late_s else 0.0
    ends = config.ends_early_s[index] if config.ends_early_s else 0.0
    running = (nominal_s >= starts) & (nominal_s <= nominal_s[-1] - ends)
    kept[int(np.flatnonzero(running)[0])] = True
    return (kept | (index == 0)) & running


def _jitter_s(clinic: Clinic, index: int) -> np.ndarray:
    config = clinic.config
    if config.stamp_jitter_s == 0:
        return np.zeros(config.frames)
    limit_s = min(JITTER_SPREADS * config.stamp_jitter_s, JITTER_LIMIT / config.fps)
    late_s = random_stream(config, "stamps", index).normal(0.0, config.stamp_jitter_s, config.frames)
    return late_s.clip(-limit_s, limit_s)
