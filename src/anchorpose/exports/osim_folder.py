"""What stands beside a TRC: the model of the patient, and set-up files of OpenSim's tools for what can be solved."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import numpy as np

from anchorpose.exports.osim_geometry import measure_body
from anchorpose.exports.osim_model import model_xml
from anchorpose.exports.osim_setup import IkSetup, ik_setup_xml, scale_setup_xml
from anchorpose.exports.product import CoordinateModel
from anchorpose.exports.source import Samples
from anchorpose.exports.stretches import runs_where, stretch_name, stretches_of
from anchorpose.joints import JOINT_NAMES

MODEL_FILE, SCALE_FILE = "model.osim", "scale_setup.xml"

# OpenSim's inverse kinematics stops for good at a frame with fewer than three markers, and repeats a coordinate's last
# value where its markers are missing. So it is given only frames in which all of trunk and legs is there; an arm or the
# head that is lost for a while does not part a recording.
_MAY_BE_MISSING: Final = ("Head", "Shoulder", "Elbow", "Wrist", "Hand")


def write_osim_files(folder: Path, trc: str, samples: Samples, model: CoordinateModel) -> tuple[str, ...]:
    """Writes model.osim, ik_setup.xml and scale_setup.xml as far as the joints allow; returns what people must know.

    Where trunk or legs are missing for a while there are several: ik_setup_001.xml and so on.
    """
    body = measure_body(samples.position_m)
    if body is None:
        return (f"No {MODEL_FILE}: some bone of the patient was never seen with both its ends.",)
    (folder / MODEL_FILE).write_text(model_xml(body, model), encoding="utf-8", newline="\n")
    known = np.isfinite(samples.position_m).all(axis=2)
    return (
        f"{MODEL_FILE} has this patient's bone lengths and joints; its masses are those of a 75 kg adult, for "
        "kinematics only.",
        *_write_ik(folder, trc, samples.time_s, known),
        *_write_scale(folder, trc, samples.time_s, known),
    )


def _write_ik(folder: Path, trc: str, time_s: np.ndarray, known: np.ndarray) -> list[str]:
    core = np.array([not name.startswith(_MAY_BE_MISSING) for name in JOINT_NAMES])
    stretches = stretches_of(known[:, core])
    used = ~core & known.any(axis=0)
    used[core] = stretches.kept
    markers = tuple(name for name, use in zip(JOINT_NAMES, used, strict=True) if use)
    count = len(stretches.runs)
    for number, (first, last) in enumerate(stretches.runs):
        setup = IkSetup(
            name=stretch_name("joints", "", number, count),
            result=stretch_name("ik_result", ".mot", number, count),
            model=MODEL_FILE,
            trc=trc,
            markers=markers,
            first_s=float(time_s[first]),
            last_s=float(time_s[last - 1]),
        )
        (folder / stretch_name("ik_setup", ".xml", number, count)).write_text(
            ik_setup_xml(setup), encoding="utf-8", newline="\n"
        )
    if not count:
        return ["No ik_setup.xml: trunk and legs are nowhere known together for two frames."]
    inside = np.concatenate([np.arange(*run) for run in stretches.runs])
    missing = int((~known[inside][:, used]).any(axis=1).sum())
    files = "ik_setup.xml" if count == 1 else f"ik_setup_001.xml to ik_setup_{count:03d}.xml, one for each stretch"
    return [
        f"In OpenSim: open {MODEL_FILE}, then Tools, Inverse Kinematics, Load {files}, Run.",
        f"Inverse kinematics is set up for {len(inside)} of {len(time_s)} frames: those with all of trunk and legs.",
        *([f"In {missing} of these a marker of head or arms is missing, and OpenSim repeats the last value of what "
           "hangs on it."] if missing else []),
    ]  # fmt: skip


def _write_scale(folder: Path, trc: str, time_s: np.ndarray, known: np.ndarray) -> list[str]:
    """A second in which all markers are there: OpenSim skips a measurement, with a warning only, where one is not."""
    runs = runs_where(np.asarray(known.all(axis=1)))
    if not runs:
        return [f"No {SCALE_FILE}: all joints are nowhere known together for two frames."]
    first, last = max(runs, key=lambda run: run[1] - run[0])
    text = scale_setup_xml(MODEL_FILE, trc, time_s[first:last])
    (folder / SCALE_FILE).write_text(text, encoding="utf-8", newline="\n")
    return []
