"""Check each camera's depth images (noise, steps, edges, holes), and whether lens and depth unit are plausible."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import cv2
import numpy as np

from anchorpose.body.visibility import MOST_MISSING
from anchorpose.calibration.first_frames import (
    USUAL_DISTANCE_M,
    FloorPlane,
    find_floor,
    noise_per_m,
    people_only,
    up_of,
)
from anchorpose.camera import Camera
from anchorpose.check.material import Finding, Level, Material, OfCamera, level_of, of_cameras
from anchorpose.isolation.background import BackgroundModel
from anchorpose.isolation.depth_noise import LIMB_M, measure_detail
from anchorpose.isolation.room_planes import find_planes
from anchorpose.isolation.view import View

# 1/m, maximum ratio of the noise's sigma to the squared depth; twice the ratio of a Kinect v1 (Khoshelham, Elberink
# 2012)
NOISY_PER_M: Final = 2 * 1.425e-3
# share of pixels without a reading above which the finding is yellow (first limit) or red (second limit); in rooms,
# windows and far walls cause 0.05 to 0.35
SOME_GONE, MOST_GONE = 0.40, 0.70
HOLED: Final = 0.15  # maximum share of pixels inside the patient's outline without a reading; hair and shoes cause less
# maximum ratio of a frame's noise to the median frame's noise; above it, the frame is disturbed. In undisturbed frames,
# the noise differs from the median frame's noise by up to 10 %.
BURST: Final = 1.3
# minimum difference between a disturbed frame's share of pixels without a reading and the median share of all frames;
# passers-by cause a smaller difference
GONE: Final = 0.05
OFTEN_BURST: Final = 0.25  # share of disturbed frames above which the finding is red instead of yellow
# share of pixels that gain or lose a reading between two frames, above which the finding is yellow (first limit) or red
# (second limit); usually, the share is 0.03
UNSTEADY, VERY_UNSTEADY = 0.10, 0.20
SPECK_PX: Final = 7  # pixels; a smaller hole or gap in the patient's pixels is closed to find the outline
LEAST_SAMPLES: Final = 5  # minimum number of frames for measuring changes between frames


def check_depth(material: Material) -> list[Finding]:
    """Return the findings on depth images; each finding covers all cameras."""
    noise, detail, room, steady, holes = (list[OfCamera]() for _ in range(5))
    for index, (camera, frames) in enumerate(material.by_camera()):
        distance_m = material.distance_m(index)
        at_m = distance_m if np.isfinite(distance_m) else USUAL_DISTANCE_M
        noise.append(_noise(camera, frames, at_m))
        detail.append(_detail(camera, frames, at_m))
        room.append(_room(camera, frames))
        steady.append(_steady(camera, frames, material.successive_of(index)))
        if views := material.views_of(index):
            holes.append(_holes(camera, views))
    found = [
        of_cameras("depth noise", noise),
        of_cameras("depth steps and edges", detail),
        of_cameras("readings in the room", room),
        of_cameras("steady readings", steady),
    ]
    return [*found, of_cameras("readings on the patient", holes)] if holes else found


def _noise(camera: Camera, frames_m: Sequence[np.ndarray], at_m: float) -> OfCamera:
    try:
        noise = noise_per_m(frames_m)
    except ValueError:
        return OfCamera(camera.name, Level.RED, "too few readings to measure", "look at the depth images")
    sigma_m = noise * at_m**2
    level = max(level_of(noise, NOISY_PER_M, np.inf), level_of(sigma_m, np.inf, LIMB_M / 2))
    remedy = "move the camera nearer to the patient, keep sunlight out, and choose its mode of high accuracy"
    return OfCamera(camera.name, level, f"{1000 * sigma_m:.0f} mm (one sigma) at {at_m:.1f} m", remedy)


def _detail(camera: Camera, frames_m: Sequence[np.ndarray], at_m: float) -> OfCamera:
    detail = measure_detail(frames_m, camera)
    edge_m, step_m = detail.edge_m(at_m), detail.step_m(at_m)
    drawn_out = max(level_of(edge_m, LIMB_M, LIMB_M), Level.YELLOW if detail.filtered else Level.GREEN)
    coarse = level_of(step_m, LIMB_M / 4, LIMB_M)
    edges = f"edges {100 * edge_m:.0f} cm wide" if detail.filtered else "sharp edges"
    measured, remedies = f"steps of {1000 * step_m:.0f} mm, {edges} at {at_m:.1f} m", list[str]()
    if drawn_out > Level.GREEN:
        measured += f": an arm can be distinguished up to {detail.limbs_until_m:.1f} m"
        remedies.append("switch off the recorder's filters (spatial, temporal, hole filling, decimation)")
    if max(drawn_out, coarse) > Level.GREEN:
        remedies.append("move the camera nearer")
    return OfCamera(camera.name, max(drawn_out, coarse), measured, "; ".join(remedies))


def _room(camera: Camera, frames_m: Sequence[np.ndarray]) -> OfCamera:
    if frames_m and people_only(frames_m, camera):
        return OfCamera(camera.name, Level.YELLOW, "the people alone, without the room", "record the whole depth image")
    missing = float(np.median([_missing(frame, camera) for frame in frames_m])) if frames_m else 1.0
    level, measured = level_of(missing, SOME_GONE, MOST_GONE), f"{100 * missing:.0f} % of the image without one"
    remedy = "close blinds and curtains against the sun; take glass and shiny floors out of view"
    return OfCamera(camera.name, level, measured, remedy)


def _missing(depth_m: np.ndarray, camera: Camera) -> float:
    return float(np.mean(depth_m[camera.valid_pixels()] <= 0))


def _steady(
    camera: Camera, frames_m: Sequence[np.ndarray], successive_m: Sequence[tuple[np.ndarray, np.ndarray]]
) -> OfCamera:
    """Return a finding on frames with more noise or fewer readings than usual, and on readings that appear and
    disappear between frames.

    The infrared light of another, unsynchronised camera disturbs the whole image at once.
    """
    if len(frames_m) < LEAST_SAMPLES:
        return OfCamera(camera.name, Level.GREEN, "too few frames to compare")
    disturbed = _disturbed(camera, frames_m)
    changes = [float(np.mean((one > 0) != (other > 0))) for one, other in successive_m]
    unsteady = float(np.median(changes)) if changes else 0.0
    level = max(level_of(float(disturbed.mean()), 0.0, OFTEN_BURST), level_of(unsteady, UNSTEADY, VERY_UNSTEADY))
    stands_out = f"{disturbed.sum()} of {len(frames_m)} frames stand out"
    remedy = "another camera's light or a flickering lamp: find it by switching them off, and synchronise the cameras"
    return OfCamera(camera.name, level, f"{stands_out}, {100 * unsteady:.0f} % of the image flickers", remedy)


def _disturbed(camera: Camera, frames_m: Sequence[np.ndarray]) -> np.ndarray:
    """Return (n,) bool: True for frames with clearly more noise, or fewer readings, than the median frame. People
    change noise and readings only slightly.
    """
    noise = np.array([noise_per_m([frame]) if np.count_nonzero(frame) else np.inf for frame in frames_m])
    missing = np.array([_missing(frame, camera) for frame in frames_m])
    emptier = missing > np.median(missing) + GONE
    if people_only(frames_m, camera):
        emptier[:] = False
    return np.asarray((noise > BURST * np.median(noise)) | emptier)


def _holes(camera: Camera, views: Sequence[View]) -> OfCamera:
    """Return a finding on the share of pixels inside the patient's outline that have no reading."""
    shares = [share for view in views if np.isfinite(share := _hole_share(view))]
    if not shares:
        return OfCamera(camera.name, Level.GREEN, "the patient is not in view")
    holed = float(np.mean(shares))
    remedy = "other clothes (dark, shiny or very loose ones return no light); keep sunlight off the patient"
    level = level_of(holed, HOLED, MOST_MISSING)  # as in tracking, red if most of the skin has no usable reading
    return OfCamera(camera.name, level, f"{100 * holed:.0f} % of the outline without a reading", remedy)


def _hole_share(view: View) -> float:
    outline = cv2.morphologyEx(view.patient.astype(np.uint8), cv2.MORPH_CLOSE, np.ones((SPECK_PX, SPECK_PX), np.uint8))
    borders, _ = cv2.findContours(outline, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    filled = cv2.drawContours(np.zeros_like(outline), borders, -1, 1, cv2.FILLED).astype(bool)
    return float(np.mean(view.depth_m[filled] <= 0)) if filled.any() else float("nan")


# degrees, smallest and largest plausible field of view; depth cameras have 43 (a cropped RealSense) to 120 (Azure
# Kinect, wide)
NARROWEST_DEG, WIDEST_DEG = 30.0, 130.0
# distance of the principal point from the image's middle, as a share of the image's size, above which the finding is
# yellow (first limit) or red (second limit); real lenses have up to 0.03
OFF_MIDDLE, FAR_OFF_MIDDLE = 0.10, 0.25
UNEQUAL: Final = 0.10  # maximum relative difference of the focal lengths fx and fy; pixels are nearly square
# m, bend of the floor (largest difference between its median heights at different distances from the optical axis)
# above which the finding is yellow (first limit) or red (second limit); real floors are flat to 2 cm, and a bend of
# 8 cm moves feet by 8 cm
BENT_M, STRONGLY_BENT_M = 0.03, 0.08
ON_FLOOR_M: Final = 0.12  # m, maximum distance of a floor reading from the floor plane; higher readings are objects
RINGS: Final = 6  # number of rings about the optical axis into which readings of the floor are divided
LEAST_READINGS: Final = 300  # minimum number of readings in a ring for computing its median
# degrees, deviation of the angle between wall and floor from a right angle, above which the finding is yellow (first
# limit) or red (second limit)
LEANS_DEG, LEANS_MUCH_DEG = 5.0, 15.0
UPRIGHT_DEG: Final = 35.0  # maximum tilt of a wall from the vertical; a more tilted plane is a ramp or a ceiling
# minimum cosine between a wall's normal and the viewing direction, since walls seen more from the side look upright
# even if lens parameters are wrong
FACING: Final = 0.5
# maximum cosine between a wall's normal and the viewing direction (an angle of 5 degrees), since the end of the
# sensor's range also looks like a wall, at an angle below 2 degrees
PARALLEL: Final = 0.996
# m, limits of a person's height: below the first limit, the finding is yellow; below the second or above the third, it
# is red. Adults have heights of 1.4 to 2.1 m (sitting: 1.1 to 1.4 m)
SHORT_M, TOO_SHORT_M, TOO_TALL_M = 1.4, 1.0, 2.2
COMPARE: Final = "compare fx, fy, cx, cy and distortion in recording.json with the camera's own calibration"
CORRECT_UNIT: Final = "correct depth_scale in recording.json (metres per grey value, 0.001 for millimetres)"
NEAREST_ROOM_M, FARTHEST_ROOM_M = 0.4, 10.0  # m, range in which depth cameras measure


def check_lens(material: Material) -> list[Finding]:
    """Return findings on the field of view, on the shape of floor and walls, and on the size of room and person."""
    fields = of_cameras("field of view", [_field_of(camera) for camera in material.cameras])
    return [fields, *_room_through_lens(material), _size(material)]


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
    """Return the angle from the first to the last known ray, NaN without a ray. rays (n,): tangents of the angles."""
    known = rays[np.isfinite(rays)]
    return float(np.degrees(np.arctan(known[-1]) - np.arctan(known[0]))) if len(known) else float("nan")


def _room_through_lens(material: Material) -> list[Finding]:
    """Return findings on how flat the floor and how upright the walls are; empty if no camera sees a floor."""
    flat, upright = list[OfCamera](), list[OfCamera]()
    for scene in material.floor_scenes:
        room, camera = scene.background, scene.camera
        floor = find_floor(room.depth_m, camera, room.sensor.noise_per_m, up=up_of(camera))
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
    """Divide the floor into rings about the optical axis, and return the largest difference (m) between the median
    heights of two rings; NaN with too few readings of the floor.

    Wrong lens parameters bend planes, more strongly at a greater distance from the axis. Noise and furniture hardly
    change medians.
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
    """Return by how many degrees the angle between floor and wall differs from a right angle, for the most upright wall
    that faces the camera; NaN without such a wall.

    A wrong focal length shears the room if the camera looks down; furniture may lean, so one upright wall is enough.
    Walls parallel to the image are left out: they stay parallel with any focal length, and the end of the sensor's
    range looks like a wall of this kind.
    """
    planes = find_planes(room.depth_m, camera, room.sensor.noise_per_m, most_beyond=1.0)
    facing = [plane[:3] for plane in planes if FACING < plane[2] < PARALLEL]
    leans = [abs(float(np.degrees(np.arcsin(np.clip(normal @ floor.up, -1.0, 1.0))))) for normal in facing]
    return min((lean for lean in leans if lean < UPRIGHT_DEG), default=float("nan"))


def _size(material: Material) -> Finding:
    """Return a finding on the person's height and the usual distance of seen surfaces; both values depend on the depth
    unit.
    """
    depths = [float(np.median(depth[depth > 0])) for _, ones in material.by_camera() for depth in ones if depth.any()]
    usual_m = float(np.median(depths)) if depths else float("nan")
    if not NEAREST_ROOM_M <= usual_m <= FARTHEST_ROOM_M:
        return Finding("depth unit", Level.RED, f"most of what is seen is {usual_m:.2f} m away", CORRECT_UNIT)
    tops, tallest = _heights_m(material)
    if not tops:
        measured = f"most of what is seen is {usual_m:.1f} m away; nobody's height could be measured"
        return Finding("depth unit", Level.GREEN, measured)
    tall_m = float(np.percentile(tops, 90))
    measured = f"the person is {tall_m:.2f} m tall, shoes and hair included"
    # the median of the heights counts, since a raised hand adds to the height, but is seldom raised for long
    if np.median(tallest) > TOO_TALL_M or tall_m < TOO_SHORT_M:
        return Finding("depth unit", Level.RED, measured, f"{CORRECT_UNIT}, or fx and fy")
    if tall_m < SHORT_M:
        remedy = f"right where they sit all the time; otherwise {CORRECT_UNIT}, or fx and fy"
        return Finding("depth unit", Level.YELLOW, measured, remedy)
    return Finding("depth unit", Level.GREEN, measured)


def _heights_m(material: Material) -> tuple[list[float], list[float]]:
    """Return two lists of heights in m above the floor, both empty without a floor. The second has the height of the
    highest person in each sampled frame with people. The first has the patient's height in each frame in which the head
    is in view; if no patient was found, it equals the second.

    The search for the patient may split a person who seems too tall into pieces. The height is still correct, since
    the highest piece counts.
    """
    floor_m, look = material.floor_m, material.look
    if floor_m is None or look is None:
        return [], []
    tallest = [max(one.person.top_m for one in each.people) - floor_m for each in look.sightings if each.people]
    patient = [one.person.top_m - floor_m for one in material.patient if not one.cut_above]
    return (patient if material.patient else tallest), tallest
