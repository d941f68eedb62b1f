"""Set-up files of OpenSim's Scale and Inverse Kinematics tools for an exported TRC."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final
from xml.etree import ElementTree

import numpy as np

from anchorpose.exports.osim_model import OSIM_VERSION, as_text

SCALED_MODEL: Final = "scaled.osim"

# How far a marker pulls. The model's chest carries no shoulder girdle and its forearm no wrist, so these say less.
_LESS: Final = {"Shoulder": 0.3, "Hand": 0.1, "Foot": 0.5, "Head": 0.5}

# What markers leave open (a turn of a straight limb about itself) stays near zero; too weak to shift what they tell.
_LOOSE: Final = ("hip_rotation", "arm_rot")
_LOOSE_WEIGHT: Final = 1e-4

# Name: markers whose distance is measured, bodies that it scales, and along which of their axes.
_MEASUREMENTS: Final = {
    "pelvis_width": (("HipLeft", "HipRight"), ("pelvis",), "Z"),
    "lower_spine": (("SpineBase", "SpineMid"), ("pelvis",), "X Y"),
    "upper_spine": (("SpineMid", "SpineShoulder"), ("torso",), "X Y"),
    "shoulder_width": (("ShoulderLeft", "ShoulderRight"), ("torso",), "Z"),
    "head": (("Neck", "Head"), ("head",), "X Y Z"),
    **{
        f"{name}_{end}": ((f"{first}{side}", f"{second}{side}"), (f"{name}_{end}",), "X Y Z")
        for side, end in (("Right", "r"), ("Left", "l"))
        for name, first, second in (
            ("femur", "Hip", "Knee"), ("tibia", "Knee", "Ankle"), ("calcn", "Ankle", "Foot"),
            ("humerus", "Shoulder", "Elbow"), ("ulna", "Elbow", "Wrist"),
        )
    },
}  # fmt: skip


@dataclass(frozen=True, slots=True)
class IkSetup:
    """Inverse kinematics of a stretch: its files, the markers that pull, and from when to when, seconds.

    result: the motion, written beside the set-up file; how far markers are off is in name_ik_marker_errors.sto.
    """

    name: str
    result: str
    model: str
    trc: str
    markers: tuple[str, ...]
    first_s: float
    last_s: float


def ik_setup_xml(setup: IkSetup) -> str:
    """A set-up file of OpenSim's inverse kinematics tool."""
    document = ElementTree.Element("OpenSimDocument", Version=OSIM_VERSION)
    tool = ElementTree.SubElement(document, "InverseKinematicsTool", name=setup.name)
    _texts(
        tool,
        results_directory=".",
        model_file=setup.model,
        constraint_weight="Inf",
        accuracy="1e-6",
        marker_file=setup.trc,
        output_motion_file=setup.result,
        time_range=f"{setup.first_s!r} {setup.last_s!r}",
        report_errors="true",
        report_marker_locations="false",
    )
    objects = _objects(tool, "IKTaskSet", "tasks")
    for name in setup.markers:
        limb = name.removesuffix("Left").removesuffix("Right")
        task = ElementTree.SubElement(objects, "IKMarkerTask", name=name)
        _texts(task, apply="true", weight=f"{_LESS.get(limb, 1.0):g}")
    for name in _LOOSE:
        for end in "rl":
            task = ElementTree.SubElement(objects, "IKCoordinateTask", name=f"{name}_{end}")
            _texts(task, apply="true", weight=f"{_LOOSE_WEIGHT:g}", value_type="default_value")
    return as_text(document)


def scale_setup_xml(model: str, markers: str, time_s: np.ndarray) -> str:
    """Scales a model whose markers are named like our joints, by the distances between them in the first of
    ``time_s`` (n,), a second at most, in which all of them are known.

    The model beside it has the patient's lengths already, so its factors come out near one; name another model in
    ``model_file`` to scale that.
    """
    document = ElementTree.Element("OpenSimDocument", Version=OSIM_VERSION)
    tool = ElementTree.SubElement(document, "ScaleTool", name="anchorpose")
    _texts(tool, mass="-1", height="-1", age="-1")
    maker = ElementTree.SubElement(tool, "GenericModelMaker")
    _texts(maker, model_file=model, marker_set_file="Unassigned")
    scaler = ElementTree.SubElement(tool, "ModelScaler")
    first_s, last_s = float(time_s[0]), float(min(time_s[0] + 1.0, time_s[-1]))
    period = f"{first_s!r} {last_s!r}"
    _texts(scaler, apply="true", scaling_order="measurements")
    measured = _objects(scaler, "MeasurementSet", "measurements")
    for name, (pair, bodies, axes) in _MEASUREMENTS.items():
        _measurement(measured, name, pair, bodies, axes)
    _texts(
        scaler, marker_file=markers, time_range=period, preserve_mass_distribution="true",
        output_model_file=SCALED_MODEL,
    )  # fmt: skip
    return as_text(document)


def _measurement(
    parent: ElementTree.Element, name: str, pair: tuple[str, str], bodies: tuple[str, ...], axes: str
) -> None:
    measurement = ElementTree.SubElement(parent, "Measurement", name=name)
    _texts(measurement, apply="true")
    pairs = _objects(measurement, "MarkerPairSet", f"{name}_pairs")
    _texts(ElementTree.SubElement(pairs, "MarkerPair", name=f"{name}_pair"), markers=" ".join(pair))
    scales = _objects(measurement, "BodyScaleSet", f"{name}_bodies")
    for body in bodies:
        _texts(ElementTree.SubElement(scales, "BodyScale", name=body), axes=axes)


def _objects(parent: ElementTree.Element, tag: str, name: str) -> ElementTree.Element:
    return ElementTree.SubElement(ElementTree.SubElement(parent, tag, name=name), "objects")


def _texts(parent: ElementTree.Element, **texts: str) -> None:
    for tag, text in texts.items():
        ElementTree.SubElement(parent, tag).text = text
