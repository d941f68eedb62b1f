"""Write what a comparison leaves behind: tables as CSV, sentences for a methods section, and the page."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np

from anchorpose import __version__
from anchorpose.agreement.evaluating import Comparison
from anchorpose.agreement.evaluation_page import page_text
from anchorpose.agreement.matching import Match
from anchorpose.agreement.rows import COLUMNS
from anchorpose.agreement.statistics import LEAST_UNITS
from anchorpose.joints import JOINT_NAMES
from anchorpose.recording.document import cell_text
from anchorpose.results.folder import FolderKind, check_results_path, whole_or_nothing

AGREEMENT_FILE: Final = "agreement.csv"
OFFSETS_FILE: Final = "offsets.csv"
ALIGNMENT_FILE: Final = "alignment.json"
METHODS_FILE: Final = "methods.txt"
PAGE_FILE: Final = "agreement.html"
COMPARISON: Final = FolderKind(
    (AGREEMENT_FILE,), (AGREEMENT_FILE, OFFSETS_FILE, ALIGNMENT_FILE, METHODS_FILE, PAGE_FILE)
)

SOURCES: Final = (
    "Bland JM, Altman DG. Agreement between methods of measurement with multiple observations per individual. J "
    "Biopharm Stat 2007. doi:10.1080/10543400701329422",
    "Zou GY. Confidence interval estimation for the Bland-Altman limits of agreement with multiple observations per "
    "individual. Stat Methods Med Res 2013. doi:10.1177/0962280211402548",
    "Ferrari A, Cutti AG, Cappello A. A new formulation of the coefficient of multiple correlation to assess the "
    "similarity of waveforms measured synchronously by different motion analysis protocols. Gait Posture 2010. "
    "doi:10.1016/j.gaitpost.2009.09.009",
    "Kuleshov V, Fenner N, Ermon S. Accurate uncertainties for deep learning using calibrated regression. ICML 2018. "
    "arXiv:1807.00263",
    "Harrington ME, Zavatsky AB, Lawson SEM, Yuan Z, Theologis TN. Prediction of the hip joint centre in adults, "
    "children, and patients with cerebral palsy based on magnetic resonance imaging. J Biomech 2007. "
    "doi:10.1016/j.jbiomech.2006.02.003",
    "Gamage SSHU, Lasenby J. New least squares solutions for estimating the average centre of rotation and the axis of "
    "rotation. J Biomech 2002. doi:10.1016/S0021-9290(01)00160-9",
)


def write_comparison(folder: Path, comparison: Comparison, overwrite: bool = False) -> None:
    """Writes all files into a new folder, or over those of an earlier comparison; raises as ``check_results_path``."""
    check_results_path(folder, None, overwrite, COMPARISON)
    methods = methods_sentences(comparison)
    with whole_or_nothing(folder, COMPARISON.own) as work:
        _write(
            work / AGREEMENT_FILE, _csv(COLUMNS, ([getattr(row, name) for name in COLUMNS] for row in comparison.rows))
        )
        _write(work / OFFSETS_FILE, _offsets(comparison))
        _write(work / ALIGNMENT_FILE, json.dumps([_alignment(match) for match in comparison.matches], indent=1) + "\n")
        _write(work / METHODS_FILE, "\n".join([*methods, "", "Sources", *SOURCES]) + "\n")
        _write(work / PAGE_FILE, page_text(comparison, [alignment_sentences(m) for m in comparison.matches], methods))


def _write(path: Path, text: str) -> None:
    path.write_text(text, encoding="utf-8", newline="\n")


def _csv(head: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(head)
    for row in rows:
        writer.writerow([cell_text(f"{cell:.6g}" if isinstance(cell, float) else cell) for cell in row])
    return text.getvalue()


def _offsets(comparison: Comparison) -> str:
    rows = [
        (str(match.results), name, *(1000.0 * match.placement.offset_m[joint]).tolist())
        for match in comparison.matches
        if match.placement is not None
        for joint, name in enumerate(JOINT_NAMES)
        if np.isfinite(match.placement.offset_m[joint]).all()
    ]
    return _csv(("results", "joint", "forward_mm", "up_mm", "right_mm"), rows)


def _alignment(match: Match) -> dict[str, Any]:
    clock, placement = match.clock, match.placement
    frame = None
    if placement is not None:
        frame = {
            "reference_to_world": placement.T_world_reference.tolist(),
            "translation_sigma_mm": _finite(1000.0 * placement.translation_sigma_m),
            "rotation_sigma_deg": _finite(placement.rotation_sigma_deg),
        }
    return {
        "anchorpose": __version__,
        "results": str(match.results),
        "reference": str(match.reference.path),
        "clock": {
            "offset_s": clock.offset_s,
            "offset_sigma_s": clock.offset_sigma_s,
            "drift": clock.drift,
            "drift_sigma": clock.drift_sigma,
            "middle_s": clock.middle_s,
            "correlation": clock.correlation,
            "overlap_s": list(clock.overlap_s),
        },
        "frame": frame,
        "understood": list(match.reference.notes),
    }


def _finite(value: float) -> float | None:
    return value if np.isfinite(value) else None


def alignment_sentences(match: Match) -> list[str]:
    """How the clocks and frames of two recordings lie, with their uncertainty, for people."""
    clock, placement = match.clock, match.placement
    begin, end = clock.overlap_s
    found = [
        f"The clock of {match.reference.path.name} is {clock.offset_s:.4f} s ahead (standard error "
        f"{1000 * clock.offset_sigma_s:.1f} ms) at {clock.middle_s:.1f} s and gains {1e6 * clock.drift:.0f} ± "
        f"{1e6 * clock.drift_sigma:.0f} microseconds per second; both recorded from {begin:.1f} to {end:.1f} s."
    ]
    if placement is None:
        return [*found, "It has angles only, so that no positions are compared."]
    if np.isfinite(placement.translation_sigma_m):
        found.append(
            f"Its frame was found from {len(match.reference.centres.joints)} joints; leaving one out moves it by "
            f"{1000 * placement.translation_sigma_m:.1f} mm and {placement.rotation_sigma_deg:.2f} degrees (standard "
            "error)."
        )
    else:
        found.append("Its frame was given.")
    return found


def methods_sentences(comparison: Comparison) -> list[str]:
    """For a methods section: what was done, in the order in which it was done."""
    people = len(set(comparison.subjects))
    unit = "subjects" if people >= LEAST_UNITS else "stretches of time longer than twice the errors' correlation time"
    frames = sum(len(match.joints.frame) for match in comparison.matches)
    origins = sorted({how for match in comparison.matches for how in match.reference.centres.origin if how})
    return [
        f"Markerless joint positions and angles (anchorpose {__version__}) were compared with those of another motion "
        f"capture system in {len(comparison.matches)} recording(s) of {people} subject(s), {frames} frames.",
        "Clock offset and drift were estimated from the recorded movement itself: first by cross-correlation of "
        "distances between joints, which do not depend on the frame of reference, then by robust least squares; "
        "standard errors are from a jackknife over ten stretches of the recording.",
        "The reference's frame was related to ours by a rigid transform, estimated together with one constant offset "
        "per joint in the axes of its segment, which represents the difference of the two definitions of a joint "
        "centre. Agreement is given as measured, and with these offsets removed.",
        f"Joint centres of the reference: {'; '.join(origins) or 'none'}.",
        "Bias and 95 % limits of agreement follow Bland and Altman (2007) for repeated measurements whose true value "
        f"varies, with {unit} as units of repetition, and intervals by variance estimates recovery (Zou 2013).",
        "Waveforms were compared by the coefficient of multiple correlation (Ferrari et al. 2010). Coverage is the "
        "share of errors within 1.96 of the stated standard deviation; expected calibration error is the mean "
        "difference between nominal and observed coverage (Kuleshov et al. 2018).",
    ]
