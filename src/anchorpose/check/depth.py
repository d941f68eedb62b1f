"""Noise, steps, edges and missing readings of each camera, where the patient is."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import cv2
import numpy as np

from anchorpose.body.visibility import MOST_MISSING
from anchorpose.calibration.noise import noise_per_m, step_per_m
from anchorpose.calibration.origin import USUAL_DISTANCE_M, people_only
from anchorpose.camera import Camera
from anchorpose.check.finding import Finding, Level, OfCamera, level_of, of_cameras
from anchorpose.check.material import Material
from anchorpose.isolation.depth_noise import LIMB_M, SHARP_EDGE_PX, DepthDetail, smear_px
from anchorpose.isolation.view import View

KINECT_V1_PER_M: Final = 1.425e-3  # Khoshelham and Elberink 2012: the noisiest camera that is common in clinics
NOISY: Final = 2.0  # times that
LIMB_LOST_M: Final = LIMB_M / 2  # one sigma as large as a limb's radius: its surface is in the noise
COARSE_M: Final = LIMB_M / 4  # steps: a limb shows in four of them
SOME_GONE, MOST_GONE = 0.40, 0.70  # of the image: 0.05 to 0.35 indoors, where windows and far walls return nothing
HOLED: Final = 0.15  # of the patient's outline: hair and shoes are less
BURST: Final = 1.3  # of the usual noise in a single frame: within 10 % from frame to frame of undisturbed cameras
GONE: Final = 0.05  # of the image that suddenly has no reading: a person who passes shadows less
OFTEN_BURST: Final = 0.25  # of the frames
UNSTEADY, VERY_UNSTEADY = 0.10, 0.20  # of the image that gains or loses its reading: 0.03 of edges and people
SPECK_PX: Final = 7  # holes between two pixels that are read, in the patient's outline
LEAST_SAMPLES: Final = 5  # frames, for what changes from one to another


def check_depth(material: Material) -> list[Finding]:
    """Each a finding over all cameras."""
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
    level = max(level_of(noise, NOISY * KINECT_V1_PER_M, np.inf), level_of(sigma_m, np.inf, LIMB_LOST_M))
    remedy = "move the camera nearer to the patient, keep sunlight out, and choose its mode of high accuracy"
    return OfCamera(camera.name, level, f"{1000 * sigma_m:.0f} mm (one sigma) at {at_m:.1f} m", remedy)


def _detail(camera: Camera, frames_m: Sequence[np.ndarray], at_m: float) -> OfCamera:
    edge_px = max(float(smear_px(frames_m)), SHARP_EDGE_PX)
    detail = DepthDetail(edge_px, camera.intrinsics.fx, step_per_m(frames_m))
    edge_m, step_m = detail.edge_m(at_m), detail.step_m(at_m)
    drawn_out = max(level_of(edge_m, LIMB_M, LIMB_M), Level.YELLOW if detail.filtered else Level.GREEN)
    coarse = level_of(step_m, COARSE_M, LIMB_M)
    edges = f"edges {100 * edge_m:.0f} cm wide" if detail.filtered else "sharp edges"
    measured, remedies = f"steps of {1000 * step_m:.0f} mm, {edges} at {at_m:.1f} m", list[str]()
    if drawn_out > Level.GREEN:
        measured += f": an arm is told apart up to {detail.limbs_until_m:.1f} m"
        remedies.append("switch off the recorder's filters (spatial, temporal, hole filling, decimation)")
    if max(drawn_out, coarse) > Level.GREEN:
        remedies.append("move the camera nearer")
    return OfCamera(camera.name, max(drawn_out, coarse), measured, "; ".join(remedies))


def _room(camera: Camera, frames_m: Sequence[np.ndarray]) -> OfCamera:
    if frames_m and all(people_only(frame) for frame in frames_m):
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
    """Frames that are noisier or emptier than the others, and readings that come and go from frame to frame.

    Light of another camera that is not synchronised comes and goes, in all of the image at once.
    """
    if len(frames_m) < LEAST_SAMPLES:
        return OfCamera(camera.name, Level.GREEN, "too few frames to compare")
    disturbed = _disturbed(camera, frames_m)
    changes = [float(np.mean((one > 0) != (other > 0))) for one, other in successive_m]
    unsteady = float(np.median(changes)) if changes else 0.0
    level = max(level_of(float(disturbed.mean()), 0.0, OFTEN_BURST), level_of(unsteady, UNSTEADY, VERY_UNSTEADY))
    stands_out = f"{disturbed.sum()} of {len(frames_m)} frames stand out"
    remedy = "another camera's light or a flickering lamp: find it by switching them off, and synchronise the cameras"
    return OfCamera(camera.name, level, f"{stands_out}, {100 * unsteady:.0f} % of the image comes and goes", remedy)


def _disturbed(camera: Camera, frames_m: Sequence[np.ndarray]) -> np.ndarray:
    """(n,) bool: frames with more noise, or fewer readings, than the others. People alone fill more or less of it."""
    noise = np.array([noise_per_m([frame]) if np.count_nonzero(frame) else np.inf for frame in frames_m])
    missing = np.array([_missing(frame, camera) for frame in frames_m])
    emptier = missing > np.median(missing) + GONE
    if all(people_only(frame) for frame in frames_m):
        emptier[:] = False
    return np.asarray((noise > BURST * np.median(noise)) | emptier)


def _holes(camera: Camera, views: Sequence[View]) -> OfCamera:
    """Share of the patient's outline without a reading."""
    shares = [share for view in views if np.isfinite(share := _hole_share(view))]
    if not shares:
        return OfCamera(camera.name, Level.GREEN, "the patient is not in view")
    holed = float(np.mean(shares))
    remedy = "other clothes (dark, shiny or very loose ones return no light); keep sunlight off the patient"
    level = level_of(holed, HOLED, MOST_MISSING)  # red as in tracking: no usable reading on most of the skin
    return OfCamera(camera.name, level, f"{100 * holed:.0f} % of the outline without one", remedy)


def _hole_share(view: View) -> float:
    outline = cv2.morphologyEx(view.patient.astype(np.uint8), cv2.MORPH_CLOSE, np.ones((SPECK_PX, SPECK_PX), np.uint8))
    borders, _ = cv2.findContours(outline, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    filled = cv2.drawContours(np.zeros_like(outline), borders, -1, 1, cv2.FILLED).astype(bool)
    return float(np.mean(view.depth_m[filled] <= 0)) if filled.any() else float("nan")
