"""The patient: found, alone, whole in view, at a good distance, not hidden; and the picture of the empty room."""

from __future__ import annotations

from typing import Final

import numpy as np

from anchorpose.camera import Camera, invert_rigid, transform_points
from anchorpose.check.material import Finding, Level, Material, OfCamera, SeenPatient, level_of, of_cameras
from anchorpose.isolation.background import BackgroundSource
from anchorpose.isolation.view import View
from anchorpose.tracker.look import Look
from anchorpose.tracker.sighting import BORDER_PX

SELDOM: Final = 0.5  # of the sampled frames
CUT_PX: Final = 3  # of the patient at a border: a hand is wider at any distance where it is resolved
SOMETIMES, MOSTLY = 0.1, 0.5  # of the frames cut off: a raised hand, or always
NEAR_M, FAR_M = 1.2, 4.0  # nearer no lens has feet and head in view; farther a forearm is ten pixels wide
BORDERS: Final = ("above", "below", "on the picture's left", "on its right")
HALF_HIDDEN, MOSTLY_HIDDEN = 0.5, 0.8  # of the skin turned to the camera: more is inferred than seen


def check_patient(material: Material) -> list[Finding]:
    """Findings on the patient; where nobody is found, why."""
    look = material.look
    if look is None:
        return [Finding("patient", Level.YELLOW, "not looked for: the cameras' poses are unknown", "see camera poses")]
    found = [_found(look)]
    if material.patient:
        found += [_whole(material), _distance(material), _hidden(material)]
    return [*found, _others(look), _mirrors(look), _empty_room(look)]


def _found(look: Look) -> Finding:
    shown, of = len(look.initial_frames), len(look.sightings)
    measured = f"found in {shown} of {of} sampled frames"
    if not shown:
        remedy = (
            "look at the depth images; record the empty room; move the camera back; if the patient never moves, name "
        )
        return Finding("patient", Level.RED, look.why_nobody, f"{remedy}the place with --patient when tracking")
    if shown < SELDOM * of:
        remedy = (
            "right where the patient comes late; otherwise another person may be taken for the patient: name the place "
            "when tracking, --patient x,z@frame, or record again without people who stand in the way"
        )
        return Finding("patient", Level.YELLOW, measured, remedy)
    return Finding("patient", Level.GREEN, measured)


def _whole(material: Material) -> Finding:
    """Cut off by which border. One camera that shows all of the patient is enough for green or yellow."""
    parts = [_cut_off(material, index, camera) for index, camera in enumerate(material.cameras)]
    worst = Level.RED if all(part.level is Level.RED for part in parts) else Level.YELLOW
    return of_cameras("whole in view", [part._replace(level=min(part.level, worst)) for part in parts])


def _cut_off(material: Material, index: int, camera: Camera) -> OfCamera:
    seen = [one for one in material.patient if (view := one.views[index]) is not None and view.patient.any()]
    if not seen:
        return OfCamera(camera.name, Level.YELLOW, "the patient is out of view", "turn the camera towards the patient")
    cut = np.array([_borders(one, index, camera, material.floor_m) for one in seen]).mean(axis=0)
    level = max(level_of(share, SOMETIMES, MOSTLY) for share in cut.tolist())
    if level is Level.GREEN:
        return OfCamera(camera.name, level, "from head to feet")
    shares = zip(BORDERS, cut.tolist(), strict=True)
    told = [f"{side} in {100 * share:.0f} %" for side, share in shares if share > SOMETIMES]
    remedy = "move the camera back, or turn it towards what is cut off"
    return OfCamera(camera.name, level, f"cut off {', '.join(told)} of the frames", remedy)


def _borders(seen: SeenPatient, index: int, camera: Camera, floor_m: float | None) -> tuple[bool, bool, bool, bool]:
    """Whether the image ends above, below, left and right of the patient before the patient does.

    Below also where the floor under the patient lies outside of the image: bars may hide the legs at the border.
    """
    view = seen.views[index]
    assert view is not None
    above, below, left, right = _touched(view)
    if floor_m is not None:
        x, z = seen.person.ground_xz_m
        place = transform_points(invert_rigid(camera.require_pose()), np.array([[x, floor_m, z]]))
        pixel = camera.project(place)[0]
        below |= bool(pixel[1] > camera.height - 1)
    return above, below, left, right


def _touched(view: View) -> tuple[bool, bool, bool, bool]:
    """Whether the patient's pixels reach the image's upper, lower, left and right border."""
    patient = view.patient
    strips = (patient[:BORDER_PX], patient[-BORDER_PX:], patient[:, :BORDER_PX].T, patient[:, -BORDER_PX:].T)
    above, below, left, right = (int(np.count_nonzero(strip.any(axis=0))) > CUT_PX for strip in strips)
    return above, below, left, right


def _distance(material: Material) -> Finding:
    parts, remedy = [], "2 to 3 m is best: the whole body is in view, and a hand has enough pixels"
    for index, camera in enumerate(material.cameras):
        away_m = material.distance_m(index)
        level = Level.GREEN if not away_m < NEAR_M and not away_m > FAR_M else Level.YELLOW
        parts.append(OfCamera(camera.name, level, f"{away_m:.1f} m" if np.isfinite(away_m) else "not in view", remedy))
    return of_cameras("distance", parts)


def _hidden(material: Material) -> Finding:
    """By equipment or people, for the camera that sees most of the patient."""
    hidden = np.array([one.hidden for one in material.patient])
    known = hidden[np.isfinite(hidden).any(axis=1)]
    if not len(known):
        return Finding("hidden", Level.YELLOW, "no body fits what is seen of the patient", "look at the depth images")
    share = float(np.median(np.nanmin(known, axis=1)))
    level = level_of(share, HALF_HIDDEN, MOSTLY_HIDDEN)
    remedy = "move the camera 10 to 20 degrees to a side on which nobody crouches, or add a second camera"
    measured = f"{100 * share:.0f} % of the patient behind equipment or people"
    return Finding("hidden", level, measured, remedy if level > Level.GREEN else "")


def _others(look: Look) -> Finding:
    most = max((len(one.people) for one in look.sightings), default=0)
    rival = look.initial_frames[0].choice.rival_xz_m if look.initial_frames else None
    if rival is not None:
        place = ",".join(f"{round(float(along), 2) + 0.0:.2f}" for along in rival)  # + 0.0: no minus before a zero
        measured = f"up to {most} people; the one at {place} may be the patient as well"
        remedy = f"if that is the patient, track with --patient {place}; look at the pictures of the report"
        return Finding("other people", Level.YELLOW, measured, remedy)
    return Finding("other people", Level.GREEN, "nobody else" if most < 2 else f"up to {most} people at a time")


def _mirrors(look: Look) -> Finding:
    if look.notes:
        remedy = "cover mirrors, or turn the camera away from them"
        return Finding("mirrors", Level.YELLOW, "; ".join(look.notes), remedy)
    return Finding("mirrors", Level.GREEN, "none found")


def _empty_room(look: Look) -> Finding:
    parts, remedy = [], "record a depth image with the equipment in place and nobody in view, as background.png"
    for scene in look.scenes:
        given = scene.background.source is BackgroundSource.PICTURE
        measured = "recorded" if given else "no picture of it"
        parts.append(OfCamera(scene.camera.name, Level.GREEN if given else Level.YELLOW, measured, remedy))
    return of_cameras("empty room", parts)
