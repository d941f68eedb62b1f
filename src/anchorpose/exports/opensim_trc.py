"""Write TRC, a file of marker positions for OpenSim with one marker per joint, and a model and set-up files for this
file.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Final
from xml.etree import ElementTree

import numpy as np

from anchorpose.exports.formats import Product, Samples, Source, number_text, rounded_text, write_rows, write_text
from anchorpose.exports.opensim_coordinates import DIGITS, SIDES
from anchorpose.exports.opensim_model import document, measure_body, model_xml, xml, xml_set, xml_texts
from anchorpose.exports.regular_time import RegularSamples, regular_samples, runs_where, stretch_name
from anchorpose.joints import JOINT_NAMES
from anchorpose.options import CoordinateModel, ExportConfig

TRC_FILE: Final = "joints.trc"

MISSING: Final = "NaN"
"""OpenSim's mark of a missing value. OpenSim refuses an empty cell at the end of a line, and reads zeros as a marker at
the origin.
"""


def write_trc(folder: Path, source: Source, config: ExportConfig) -> Product:
    """Write joints.trc, and beside it the files that OpenSim needs to process it."""
    regular = regular_samples(source.samples)
    samples = regular.samples
    write_rows(folder / TRC_FILE, "\t", trc_head(regular), trc_body(samples))
    return Product(
        axes="OpenSim's: X forward, Y up, Z to the patient's right",
        units="metres, seconds",
        time=str(regular.base),
        missing=f"{MISSING} in all three cells of a marker; OpenSim's inverse kinematics leaves such a marker out",
        counts=(
            ("frames", len(samples.time_s)),
            ("rate_hz", regular.rate_hz),
            ("recorded_frames", int(regular.interpolation.recorded.sum())),
            ("missing_markers", int(np.isnan(samples.position_m[..., 0]).sum())),
        ),
        notes=write_osim_files(folder, samples, int(regular.interpolation.bridged.sum()), config.model),
    )


_ORIGINAL: Final = ("OrigDataRate", "OrigDataStartFrame", "OrigNumFrames")


def trc_head(regular: RegularSamples) -> list[list[str]]:
    """Return the cells of the TRC file's header, the lines before the lines of the frames."""
    rate, count = number_text(regular.rate_hz), len(regular.samples.time_s)
    markers = range(1, len(JOINT_NAMES) + 1)
    return [
        ["PathFileType", "4", "(X/Y/Z)", TRC_FILE],
        ["DataRate", "CameraRate", "NumFrames", "NumMarkers", "Units", *_ORIGINAL],
        [rate, rate, str(count), str(len(JOINT_NAMES)), "m", rate, "1", str(count)],
        ["Frame#", "Time", *(cell for name in JOINT_NAMES for cell in (name, "", ""))],
        ["", "", *(f"{axis}{marker}" for marker in markers for axis in "XYZ")],
        [""],
    ]


def trc_body(samples: Samples) -> Iterator[list[str]]:
    """Yield, for each frame, the cells of its line in the TRC file."""
    for number, (time_s, place) in enumerate(zip(samples.time_s.tolist(), samples.position_m, strict=True), 1):
        yield [str(number), repr(time_s), *(rounded_text(x, DIGITS, MISSING) for x in place.ravel().tolist())]


SCALED_MODEL: Final = "scaled.osim"

# Weights of markers; all other markers have the weight 1. Shoulder girdle and wrist do not move in the model, so
# markers there fit less well.
_MARKER_WEIGHT: Final = {"Shoulder": 0.3, "Hand": 0.1, "Foot": 0.5, "Head": 0.5}

# Coordinates that inverse kinematics holds near zero, since markers do not determine the rotation of a straight limb
# about its long axis.
_FREE: Final = ("hip_rotation", "arm_rot")
# Weight with which the coordinates in ``_FREE`` are held near zero, so small that it does not shift coordinates that
# markers determine
_FREE_WEIGHT: Final = 1e-4

# For each measurement, by name: the two markers whose distance is measured, the body to scale, and the axes along which
# the body is scaled.
_MEASUREMENTS: Final = {
    "pelvis_width": (("HipLeft", "HipRight"), "pelvis", "Z"),
    "lower_spine": (("SpineBase", "SpineMid"), "pelvis", "X Y"),
    "upper_spine": (("SpineMid", "SpineShoulder"), "torso", "X Y"),
    "shoulder_width": (("ShoulderLeft", "ShoulderRight"), "torso", "Z"),
    "head": (("Neck", "Head"), "head", "X Y Z"),
    **{
        f"{name}_{end}": ((f"{first}{side}", f"{second}{side}"), f"{name}_{end}", "X Y Z")
        for side, end, _ in SIDES
        for name, first, second in (
            ("femur", "Hip", "Knee"),
            ("tibia", "Knee", "Ankle"),
            ("calcn", "Ankle", "Foot"),
            ("humerus", "Shoulder", "Elbow"),
            ("ulna", "Elbow", "Wrist"),
        )
    },
}


MODEL_FILE, SCALE_FILE = "model.osim", "scale_setup.xml"


def ik_setup_xml(name: str, result: str, markers: Sequence[str], period_s: Iterable[float]) -> str:
    """Return a set-up file of OpenSim's inverse kinematics tool for a stretch of frames; markers: the markers to use.

    result: name of the motion file. OpenSim writes this file beside the set-up file, and the marker errors to
    ``name``_ik_marker_errors.sto. period_s: times of the first and the last frame.
    """
    settings = xml_texts(
        results_directory=".",
        model_file=MODEL_FILE,
        constraint_weight="Inf",
        accuracy="1e-6",
        marker_file=TRC_FILE,
        output_motion_file=result,
        time_range=_range(period_s),
        report_errors="true",
        report_marker_locations="false",
    )
    tasks = []
    for marker in markers:
        weight = _MARKER_WEIGHT.get(marker.removesuffix("Left").removesuffix("Right"), 1.0)
        tasks.append(xml("IKMarkerTask", *xml_texts(apply="true", weight=f"{weight:g}"), name=marker))
    for coordinate in (f"{free}_{end}" for free in _FREE for end in "rl"):
        texts = xml_texts(apply="true", weight=f"{_FREE_WEIGHT:g}", value_type="default_value")
        tasks.append(xml("IKCoordinateTask", *texts, name=coordinate))
    return document(xml("InverseKinematicsTool", *settings, xml_set("IKTaskSet", "tasks", tasks), name=name))


def scale_setup_xml(time_s: np.ndarray) -> str:
    """Return a set-up file of OpenSim's scale tool, for a model whose markers are named like the joints. The tool uses
    distances between markers in at most the first second. time_s (n,): times of successive frames in which all markers
    are known.

    The file names model.osim, which has the patient's bone lengths already, so the scale factors are near one. To scale
    another model, change the name in the file's element ``model_file``.
    """
    files = xml_texts(
        marker_file=TRC_FILE,
        time_range=_range((time_s[0], min(time_s[0] + 1.0, time_s[-1]))),
        preserve_mass_distribution="true",
        output_model_file=SCALED_MODEL,
    )
    measured = (_measurement(name, *measurement) for name, measurement in _MEASUREMENTS.items())
    scaler = xml(
        "ModelScaler",
        *xml_texts(apply="true", scaling_order="measurements"),
        xml_set("MeasurementSet", "measurements", measured),
        *files,
    )
    maker = xml("GenericModelMaker", *xml_texts(model_file=MODEL_FILE, marker_set_file="Unassigned"))
    return document(xml("ScaleTool", *xml_texts(mass="-1", height="-1", age="-1"), maker, scaler, name="anchorpose"))


def _range(period_s: Iterable[float]) -> str:
    return " ".join(repr(float(second)) for second in period_s)


def _measurement(name: str, pair: tuple[str, str], body: str, axes: str) -> ElementTree.Element:
    markers = xml("MarkerPair", xml("markers", " ".join(pair)), name=f"{name}_pair")
    pairs = xml_set("MarkerPairSet", f"{name}_pairs", [markers])
    scales = xml_set("BodyScaleSet", f"{name}_bodies", [xml("BodyScale", xml("axes", axes), name=body)])
    return xml("Measurement", xml("apply", "true"), pairs, scales, name=name)


# OpenSim's inverse kinematics stops at a frame with fewer than three markers, and repeats a coordinate's last value
# where the markers that determine it are missing. So the tool gets only frames in which all joints of trunk and legs
# are known. Missing arms or head do not split a recording.
_MAY_BE_MISSING: Final = ("Head", "Shoulder", "Elbow", "Wrist", "Hand")


def write_osim_files(folder: Path, samples: Samples, frames: int, model: CoordinateModel) -> tuple[str, ...]:
    """Write model.osim, ik_setup.xml and scale_setup.xml, each if enough joints are known; return notes for users.
    frames: number of frames of ``samples`` that are not in a gap of the recording.

    If trunk or legs are missing for a while, inverse kinematics gets several set-up files: ik_setup_001.xml and so on.
    """
    body = measure_body(samples.position_m)
    if body is None:
        return (f"No {MODEL_FILE}: for some bone, both ends were never known in one frame.",)
    write_text(folder / MODEL_FILE, model_xml(body, model))
    known = np.isfinite(samples.position_m).all(axis=2)
    return (
        f"{MODEL_FILE} has the bone lengths and joints of this patient; its masses are those of a 75 kg adult, for "
        "kinematics only.",
        *_write_ik(folder, samples.time_s, known, frames),
        *_write_scale(folder, samples.time_s, known),
    )


def _write_ik(folder: Path, time_s: np.ndarray, known: np.ndarray, frames: int) -> list[str]:
    core = np.array([not name.startswith(_MAY_BE_MISSING) for name in JOINT_NAMES])
    used = core | known.any(axis=0)
    markers = tuple(name for name, use in zip(JOINT_NAMES, used, strict=True) if use)
    runs = runs_where(np.asarray(known[:, core].all(axis=1)))
    count = len(runs)
    for number, (first, last) in enumerate(runs):
        name, result = stretch_name("joints", "", number, count), stretch_name("ik_result", ".mot", number, count)
        text = ik_setup_xml(name, result, markers, time_s[[first, last - 1]])
        write_text(folder / stretch_name("ik_setup", ".xml", number, count), text)
    if not count:
        return ["No ik_setup.xml: trunk and legs are nowhere known together for two frames."]
    inside = np.concatenate([np.arange(*run) for run in runs])
    missing = int((~known[inside][:, used]).any(axis=1).sum())
    files = "ik_setup.xml" if count == 1 else f"ik_setup_001.xml to ik_setup_{count:03d}.xml, one for each stretch"
    notes = [
        f"In OpenSim: open {MODEL_FILE}, then Tools, Inverse Kinematics, Load {files}, Run.",
        f"Inverse kinematics is set up for {len(inside)} of {frames} frames: those with all of trunk and legs, two or "
        "more in a row.",
        f"In {missing} of these a marker of head or arms is missing, and OpenSim repeats the last value of the "
        "coordinates that depend on it.",
    ]
    return notes if missing else notes[:2]


def _write_scale(folder: Path, time_s: np.ndarray, known: np.ndarray) -> list[str]:
    """Write the set-up of the scale tool. The tool uses at most a second in which all markers are known, since OpenSim
    skips the measurements that need a missing marker, and warns.
    """
    runs = runs_where(np.asarray(known.all(axis=1)))
    if not runs:
        return [f"No {SCALE_FILE}: all joints are nowhere known together for two frames."]
    first, last = max(runs, key=lambda run: run[1] - run[0])
    write_text(folder / SCALE_FILE, scale_setup_xml(time_s[first:last]))
    return []
