"""Whether the lens and the depth unit of the recording are plausible, by what they make of floor, walls and people."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from anchorpose.calibration.floor import FloorPlane, find_floor, up_of
from anchorpose.camera import Camera
from anchorpose.check.finding import Finding, Level, OfCamera, level_of, of_cameras
from anchorpose.check.material import Material
from anchorpose.isolation.background import BackgroundModel
from anchorpose.isolation.room_planes import find_planes

NARROWEST_DEG, WIDEST_DEG = 30.0, 130.0  # depth cameras have 43 (a cropped RealSense) to 120 (Azure Kinect, wide)
OFF_MIDDLE, FAR_OFF_MIDDLE = 0.10, 0.25  # of the image's size: real lenses are 3 % off; more is another image size
UNEQUAL: Final = 0.10  # between fx and fy: pixels are square
BENT_M, STRONGLY_BENT_M = 0.03, 0.08  # floors are flat to 2 cm; a bend of 8 moves feet by as much
ON_FLOOR_M: Final = 0.12  # from the plane: higher is what stands on the floor
RINGS: Final = 6
LEAST_READINGS: Final = 300  # of one ring, for its median
LEANS_DEG, LEANS_MUCH_DEG = 5.0, 15.0  # rooms have right angles; planes of 3 % of the image are measured to 1 degree
UPRIGHT_DEG: Final = 35.0  # from upright: beyond this it is a ramp or a sloping ceiling, no wall
FACING: Final = 0.5  # cosine between a wall and the view: the corner of others with the floor stays right anyway
PARALLEL: Final = 0.996  # the same, 5 degrees: what is cut off at the sensor's range is within 2
SHORT_M, TOO_SHORT_M, TOO_TALL_M = 1.4, 1.0, 2.2  # adults stand 1.4 to 2.1 m tall, sit 1.1 to 1.4
COMPARE: Final = "compare fx, fy, cx, cy and distortion in recording.json with the camera's own calibration"
CORRECT_UNIT: Final = "correct depth_scale in recording.json (metres per grey value, 0.001 for millimetres)"
NEAREST_ROOM_M, FARTHEST_ROOM_M = 0.4, 10.0  # where depth cameras measure


def check_lens(material: Material) -> list[Finding]:
    """Field of view; floor and walls through the lens; the size of the room and of the person."""
    return [_field_of_view(material), *_room_through_lens(material), _size(material)]


def _field_of_view(material: Material) -> Finding:
    return of_cameras("field of view", [_field_of(camera) for camera in material.cameras])


def _field_of(camera: Camera) -> OfCamera:
    rays, lens = camera.pixel_rays(), camera.intrinsics
    across, down = _angle_deg(rays[camera.height // 2, :, 0]), _angle_deg(rays[:, camera.width // 2, 1])
    off = max(abs(lens.cx / (camera.width - 1) - 0.5), abs(lens.cy / (camera.height - 1) - 0.5))
    level = max(
        Level.GREEN if NARROWEST_DEG <= max(across, down) <= WIDEST_DEG else Level.RED,
        level_of(off, OFF_MIDDLE, FAR_OFF_MIDDLE),
        level_of(abs(lens.fx / lens.fy - 1.0), UNEQUAL, 3.0 * UNEQUAL),
    )
    measured = f"{across:.0f} x {down:.0f} degrees, its middle {100 * off:.0f} % off the image's"
    return OfCamera(camera.name, level, measured, f"{COMPARE}: they are of another image size, or of the colour camera")


def _angle_deg(rays: np.ndarray) -> float:
    """From the first to the last ray of a line of pixels (n,), the tangents of their angles; NaN without a ray."""
    known = rays[np.isfinite(rays)]
    return float(np.degrees(np.arctan(known[-1]) - np.arctan(known[0]))) if len(known) else float("nan")


def _room_through_lens(material: Material) -> list[Finding]:
    """How flat the floor and how upright the walls are; nothing where no camera sees a floor."""
    flat, upright = list[OfCamera](), list[OfCamera]()
    for scene in material.floor_scenes:
        room, camera = scene.background, scene.camera
        floor = find_floor(room.depth_m, camera, room.noise_per_m, up=up_of(camera))
        if not isinstance(floor, FloorPlane):
            continue
        bend_m, lean_deg = _bend_m(room.depth_m, camera, floor), _lean_deg(room, camera, floor)
        if np.isfinite(bend_m):
            level = level_of(bend_m, BENT_M, STRONGLY_BENT_M)
            measured = f"bent by {100 * bend_m:.0f} cm from the middle of the image to its border"
            flat.append(OfCamera(camera.name, level, measured, f"switch the camera's smoothing off; {COMPARE}"))
        if np.isfinite(lean_deg):
            level = level_of(lean_deg, LEANS_DEG, LEANS_MUCH_DEG)
            measured = f"{90 - lean_deg:.0f} degrees between floor and wall"
            upright.append(OfCamera(camera.name, level, measured, COMPARE))
    return [of_cameras(what, parts) for what, parts in (("floor flat", flat), ("room square", upright)) if parts]


def _bend_m(room_m: np.ndarray, camera: Camera, floor: FloorPlane) -> float:
    """How far the floor's medians in rings about the axis differ; NaN where the floor is in fewer than three rings.

    A wrong lens bends planes, and more so the farther from the axis; noise and furniture leave the medians where they
    are.
    """
    above_m = camera.back_project(room_m) @ floor.up.astype(np.float32) + np.float32(floor.height_m)
    radius = np.linalg.norm(camera.pixel_rays(), axis=-1)
    on_floor = np.abs(above_m) < ON_FLOOR_M
    if np.count_nonzero(on_floor) < LEAST_READINGS * RINGS:
        return float("nan")
    edges = np.quantile(radius[on_floor], np.linspace(0.0, 1.0, RINGS + 1))
    rings = np.clip(np.searchsorted(edges, radius[on_floor], side="right") - 1, 0, RINGS - 1)
    medians = [float(np.median(above_m[on_floor][rings == ring])) for ring in range(RINGS)]
    return float(np.ptp(medians))


def _lean_deg(room: BackgroundModel, camera: Camera, floor: FloorPlane) -> float:
    """How far the most upright of the walls that face the camera is from a right angle with the floor; NaN without.

    A wrong focal length shears a room that is seen from above; furniture may lean, so that one wall is enough. A wall
    parallel to the image stays so whatever the lens is, and where the sensor's range cuts a wall off, the strip that is
    left of it looks like one.
    """
    planes = find_planes(room.depth_m, camera, room.noise_per_m, most_beyond=1.0)
    facing = [plane[:3] for plane in planes if FACING < plane[2] < PARALLEL]
    leans = [abs(float(np.degrees(np.arcsin(np.clip(normal @ floor.up, -1.0, 1.0))))) for normal in facing]
    return min((lean for lean in leans if lean < UPRIGHT_DEG), default=float("nan"))


def _size(material: Material) -> Finding:
    """Height of the person and distance of the room: both are in the depth unit."""
    depths = [float(np.median(depth[depth > 0])) for _, ones in material.by_camera() for depth in ones if depth.any()]
    usual_m = float(np.median(depths)) if depths else float("nan")
    if not NEAREST_ROOM_M <= usual_m <= FARTHEST_ROOM_M:
        return Finding("depth unit", Level.RED, f"most of what is seen is {usual_m:.2f} m away", CORRECT_UNIT)
    tops = _heights_m(material)
    if not tops:
        measured = f"most of what is seen is {usual_m:.1f} m away; nobody's height could be measured"
        return Finding("depth unit", Level.GREEN, measured)
    tall_m, usually_m = float(np.percentile(tops, 90)), float(np.median(tops))  # a raised hand is seldom up for long
    measured = f"the person is {tall_m:.2f} m tall, shoes and hair included"
    if usually_m > TOO_TALL_M or tall_m < TOO_SHORT_M:
        return Finding("depth unit", Level.RED, measured, f"{CORRECT_UNIT}, or fx and fy")
    if tall_m < SHORT_M:
        remedy = f"right where they sit all the time; otherwise {CORRECT_UNIT}, or fx and fy"
        return Finding("depth unit", Level.YELLOW, measured, remedy)
    return Finding("depth unit", Level.GREEN, measured)


def _heights_m(material: Material) -> Sequence[float]:
    """Above the floor, of the patient where the head is in view, or of the highest who is seen where nobody has the
    shape of a person; none without a floor."""
    floor_m = material.floor_m
    if floor_m is None or material.look is None:
        return []
    if material.patient:
        return [one.person.top_m - floor_m for one in material.patient if not one.cut_above]
    shown = [sighting.people for sighting in material.look.sightings if sighting.people]
    return [max(one.person.top_m for one in people) - floor_m for people in shown]
