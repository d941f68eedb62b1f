"""Write report.html from the tables, run.json and pictures of a results folder. The page contains everything that it
shows, so a browser needs no other files.
"""

from __future__ import annotations

import base64
import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, NamedTuple

import cv2
import numpy as np

from anchorpose.calibration.first_frames import USUAL_DISTANCE_M
from anchorpose.errors import InputError
from anchorpose.isolation.depth_noise import DepthNoise
from anchorpose.joints import LOST
from anchorpose.recording.regular_file import read_image
from anchorpose.report.condition_section import condition_section, with_reference
from anchorpose.report.detectable import Detectable, read_detectable
from anchorpose.report.measure_section import measure_section
from anchorpose.report.motion_section import angle_section, joint_charts, state_table
from anchorpose.report.session import Session, read_session
from anchorpose.report.summary import moment_section, summary
from anchorpose.report.timeline import timeline
from anchorpose.report.words import STATE_WORDS, counted, named_part, render_page, spaced
from anchorpose.results.folder import write_text_whole
from anchorpose.results.run_record import RUN_FILE

MOST_LINES: Final = 60
"""Maximum number of problems listed on the page; all further problems are only counted on the page, and listed in
run.json.
"""


# px; minimum width of patches of pixels with a common depth error that the page mentions; in smaller patches, the
# errors of neighbouring pixels are almost independent
ALIKE_PX: Final = 1.5


def problems(session: Session) -> list[str]:
    """Return a sentence per run of frames with the same problem, such as a lost patient or poor depth."""
    sentences = [_stretch(drops) for drops in _stretches(session.run.get("dropped", []))]
    sentences += [f"{_frames(entry)}: the patient is lost: {entry['why']}" for entry in session.run.get("lost", [])]
    sentences += [f"{_frames(entry)}: {entry['why']}" for entry in session.run.get("poor_depth", [])]
    more = len(sentences) - MOST_LINES
    if more > 0:
        last = f"and {counted(more, 'more stretch', 'more stretches')}: see {RUN_FILE}"
        return [*sentences[:MOST_LINES], last]
    return sentences


def _frames(entry: dict[str, Any]) -> str:
    """Return the frames and times of an interval of run.json as text."""
    first, last, start_s = entry["first_frame"], entry["last_frame"], entry["start_s"]
    if last == first:
        return f"Frame {first} ({start_s:.2f} s)"
    return f"Frames {first} to {last} ({start_s:.2f} to {entry['end_s']:.2f} s)"


def _stretches(dropped: Sequence[dict[str, Any]]) -> list[list[dict[str, Any]]]:
    """Group the dropped frames into runs of neighbouring frames with the same reason. Reasons that differ only in the
    frame number of a file name count as equal.
    """
    stretches: list[list[dict[str, Any]]] = []
    for drop in sorted(dropped, key=lambda drop: (_reason(drop), drop["frame"])):
        last = stretches[-1][-1] if stretches else None
        if last is not None and _reason(last) == _reason(drop) and drop["frame"] - last["frame"] <= 1:
            stretches[-1].append(drop)
        else:
            stretches.append([drop])
    return sorted(stretches, key=lambda drops: drops[0]["frame"])


def _reason(drop: dict[str, Any]) -> str:
    return str(drop["why"]).replace(f"{drop['frame']:06d}", "…")


def _stretch(drops: Sequence[dict[str, Any]]) -> str:
    first, last = drops[0], drops[-1]
    ends = {"first_frame": first["frame"], "last_frame": last["frame"]}
    times = {"start_s": first["time_s"], "end_s": last["time_s"]}
    return f"{_frames(ends | times)}: {first['why'] if len(drops) == 1 else _reason(first)}"


def corrections(session: Session) -> list[str]:
    """Return a sentence, with the reviewer's name, for each correction that tracking used, and a last sentence that
    names the corrections file; see ``CorrectionsRecord``.
    """
    record = session.run.get("corrections")
    if record is None:
        return []
    unusable = [
        f"Unusable: frames {entry['first_frame']} to {entry['last_frame']} "
        f"({entry['start_s']:.2f} to {entry['end_s']:.2f} s): {_signed(entry)}"
        for entry in record["unusable"]
    ]
    joints = [
        f"Placed by hand: {named_part(entry['joint'])} in frame {entry['frame']} ({entry['time_s']:.2f} s): "
        f"{_signed(entry)}"
        for entry in record["joints"]
    ]
    patient = record.get("patient")  # the run.json of older results lacks this entry
    named = [] if patient is None else [_named(patient)]
    return [*named, *unusable, *joints, f"These are from {record['file']}, SHA-256 {record['sha256']}."]


def _named(patient: dict[str, Any]) -> str:
    x, _, z = patient["position_m"]
    where = f"at x {x:.2f} m, z {z:.2f} m in frame {patient['frame']} ({patient['time_s']:.2f} s)"
    return f"The patient was named: the person {where}: {_signed(patient)}"


def _signed(entry: dict[str, Any]) -> str:
    return f"{entry['reason']} ({entry['who']}, {entry['when']})"


class Facts(NamedTuple):
    """A table that the page shows only when the user unfolds it. rows: (name, cells) of each row, empty if run.json has
    no entry for the table.
    """

    title: str
    head: Sequence[str]
    rows: Sequence[tuple[str, Sequence[str]]]


def provenance(session: Session) -> list[Facts]:
    """Return tables of versions, cameras, calibration residuals, the learnt body, computing times and input hashes."""
    run = session.run
    measured = session.definition.anchorpose if session.definition else "measures.parquet does not say"
    versions = [*run.get("versions", {}).items(), ("the measures: anchorpose", measured)]
    residuals = [(r["camera"], (r["what"], _residual(r))) for r in run.get("residuals", [])]
    return [
        Facts("Versions", ("program", "version"), [(program, (version,)) for program, version in versions]),
        Facts(
            "Cameras",
            ("camera", "pose from", "position x, y, z in metres", "depth 2.5 m away, as the recording shows it"),
            [(one["name"], (one["source"], _position(one), _depth(one))) for one in run.get("cameras", [])],
        ),
        Facts("Calibration residuals", ("camera", "what", "value"), residuals),
        Facts("The patient's body as learnt", ("what", "value"), _body(run.get("body"))),
        Facts(
            "Time spent",
            ("stage", "seconds"),
            [(timing["stage"], (f"{timing['seconds']:.1f}",)) for timing in run.get("timings", [])],
        ),
        Facts("Input files", ("file", "SHA-256"), session.inputs),
    ]


def _residual(residual: dict[str, Any]) -> str:
    if residual["value"] is None:
        return "not known"
    return f"{residual['value']:.4g} {residual['unit']}".replace(" 1", "")


def _position(camera: dict[str, Any]) -> str:
    pose = camera.get("camera_to_world")
    return "not used" if pose is None else ", ".join(f"{row[3]:.2f}" for row in pose[:3])


def _depth(camera: dict[str, Any]) -> str:
    """Describe a camera's depth in words: its noise, and the step between two successive depth values, both at 2.5 m,
    where patients stand; and the width in pixels over which an edge in depth is blurred. Results of older versions lack
    these values.
    """
    depth = camera.get("depth")
    if depth is None:
        return "not known"
    step_mm = 1000 * USUAL_DISTANCE_M**2 * depth["step_per_m"]
    noise = _noise(DepthNoise(**depth["noise"]))
    return f"{noise}; steps of {step_mm:.0f} mm, edges {depth['edge_px']:.0f} pixels wide"


def _noise(noise: DepthNoise) -> str:
    """Return the random error of a camera's depth in words."""
    at_m = f"± {1000 * float(noise.sigma_m(np.array(USUAL_DISTANCE_M))):.0f} mm (one sigma)"
    if not noise.measured:
        return f"{at_m} between neighbouring readings; no still background is seen to measure all of the noise on"
    known = zip(noise.slants, ("slanted", "steep"), strict=True)
    more = [f"{times:.1f} times as much on {kind} surfaces" for times, kind in known if times is not None]
    shared = np.sqrt(noise.shared_px)
    alike = f"neighbours have their error in common over {shared:.0f} pixels" if shared >= ALIKE_PX else ""
    lost = "" if noise.holes is None else f"{100 * noise.holes:.1f} % of the readings on surfaces of the room are lost"
    between = "" if noise.flying is None else f"{100 * noise.flying:.0f} % of those at depth edges show neither side"
    return "; ".join(part for part in (f"{at_m}, measured on the still room", *more, alike, lost, between) if part)


def _body(body: dict[str, Any] | None) -> list[tuple[str, Sequence[str]]]:
    if body is None:
        return [("no body was learnt", ("",))]
    height = f"{body['height_m']:.3f} ± {body['height_sigma_m']:.3f} m (one sigma)"
    rows = {"height without shoes": height}
    for piece, thick_m in body.get("clothes_m", {}).items():
        rows[f"thickness of the {piece}"] = f"{1000 * thick_m:.0f} mm"
    for bone in body["bones"]:
        rows[spaced(bone["bone"])] = f"{1000 * bone['length_m']:.0f} ± {1000 * bone['sigma_m']:.0f} mm (one sigma)"
    return [(what, (value,)) for what, value in rows.items()]


WEBP_QUALITY: Final = 80
"""Quality of WebP at which lines and names stay sharp, with files a quarter as large as the PNG files in the results
folder.
"""


@dataclass(frozen=True, slots=True, kw_only=True)
class Figure:
    """A picture for the page. size: (width, height) in pixels; data: WebP in base64, empty if the file is damaged."""

    caption: str
    size: tuple[int, int]
    data: str


class KeptFrame(NamedTuple):
    """A frame that is shown as pictures: the reason why it was chosen, the number of joints seen in it, and each
    camera's picture.
    """

    frame: int
    title: str
    seen: str
    figures: list[Figure]


def kept_frames(session: Session) -> list[KeptFrame]:
    """Return the frames with pictures in the results folder, in the order of run.json."""
    by_frame: dict[int, list[dict[str, Any]]] = {}
    for picture in session.run.get("pictures", []):
        if (session.folder / picture["file"]).is_file():
            by_frame.setdefault(picture["frame"], []).append(picture)
    return [_kept_frame(session, frame, pictures) for frame, pictures in by_frame.items()]


def _kept_frame(session: Session, frame: int, pictures: Sequence[dict[str, Any]]) -> KeptFrame:
    why = pictures[0].get("why")
    title = f"Frame {frame}, {pictures[0]['time_s']:.2f} s" + (f": {why}" if why else "")
    figures = [_figure(session.folder, picture) for picture in pictures]
    return KeptFrame(frame, title, _seen_then(session, frame), figures)


def _figure(folder: Path, picture: dict[str, Any]) -> Figure:
    """Decode the picture and encode it again, so that only its pixels get into the page, and not other content of its
    file.
    """
    caption = f"Camera {picture['camera']}. {picture['caption']}"
    pixels = read_image(folder / picture["file"], cv2.IMREAD_COLOR)
    if pixels is None:
        return Figure(caption=f"{caption} This picture is damaged.", size=(0, 0), data="")
    webp = cv2.imencode(".webp", pixels, [cv2.IMWRITE_WEBP_QUALITY, WEBP_QUALITY])[1].tobytes()
    size = (pixels.shape[1], pixels.shape[0])
    return Figure(caption=caption, size=size, data=base64.b64encode(webp).decode("ascii"))


def _seen_then(session: Session, frame: int) -> str:
    found = np.flatnonzero(session.joints.frame == frame)
    if not len(found):
        return ""
    states = session.joints.state_code[found[0]]
    seen, lost = int((states == 0).sum()), int((states == LOST).sum())
    return f"{seen} of {len(states)} joints seen, {len(states) - seen - lost} inferred, {lost} lost."


REPORT_FILE: Final = "report.html"


def write_report(
    results: Path, reliability: Path | None = None, measures: Sequence[str] = (), reference: str = ""
) -> Path:
    """Write report.html into a results folder and return its path. The same results, with the same scores of raters,
    always give a page with the same bytes.

    reliability: a table of ``anchorpose reliability``; a difference between conditions below the table's minimal
    detectable change does not count as demonstrated; measures: names of the measures that are compared between
    conditions, empty for the main measures; reference: the condition with which all others are compared, empty for the
    first trial's condition. Raises InputError if a table or run.json is missing or unusable, if no trial has the
    reference condition, or if one of the three arguments is given for results without trials. No page is written in
    these cases.
    """
    session = read_session(results)
    if session.trials is None and (reliability is not None or measures or reference):
        remedy = "leave out --reliability, --measure and --reference, or run 'anchorpose measure' with --events first"
        raise InputError(results, "has no trials whose conditions could be compared", remedy)
    if session.trials is not None and reference:
        session = with_reference(session, session.trials, reference)
    detectable = {} if reliability is None else read_detectable(reliability, session.trial_measures)
    write_text_whole(results / REPORT_FILE, _page(session, detectable, measures))
    return results / REPORT_FILE


def _page(session: Session, detectable: Detectable, chosen: Sequence[str]) -> str:
    return render_page(
        "anchorpose.report",
        "templates/page.html",
        title=f"Stand training: {session.recording}",
        state_titles=["joint", *(f"{words}, %" for words in STATE_WORDS.values()), "typical ±, mm"],
        thinned=_thinned(session),
        pictures=kept_frames(session),
        problems=problems(session),
        notes=[str(note) for note in session.run.get("notes", [])],
        corrections=corrections(session),
        provenance=provenance(session),
        settings=json.dumps(session.run.get("config"), indent=1, ensure_ascii=False),
        summary=summary(session),
        timeline=timeline(session),
        moments=moment_section(session),
        measures=measure_section(session),
        conditions=condition_section(session, detectable, chosen),
        repeated=bool(detectable),
        angles=angle_section(session),
        states=state_table(session),
        joints=joint_charts(session),
    )


def _thinned(session: Session) -> str:
    if not session.bins.thinned:
        return "Every frame is drawn."
    frames, groups = counted(len(session.joints.frame), "frame"), counted(session.bins.count, "group")
    return (
        f"The {frames} are drawn in {groups} of neighbours, each from its lowest to its highest value, so that peaks "
        "stay (a line runs in the middle, a darker band from one to the other); all frames are in the tables."
    )
