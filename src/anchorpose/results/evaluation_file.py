"""Write an evaluation as JSON for programs, and format it as text for people."""

from __future__ import annotations

import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any, Final

from anchorpose.joints import JOINT_COUNT
from anchorpose.results.contact_scores import ContactEvaluation
from anchorpose.results.evaluate import CONFIDENT_SIGMAS, FAR_M, Evaluation
from anchorpose.results.folder import write_text_whole
from anchorpose.results.run_record import as_json
from anchorpose.results.truth import WRONG_M

MARK: Final = '"matched_frames"'
"""Text near the beginning of every evaluation file, by which the file is recognised."""


def write_evaluation(path: Path, evaluation: Evaluation) -> None:
    """Write the evaluation as JSON: errors of all joints together, of each joint, and of the joints in each state (such
    as ``hidden_by_self``), then all other fields.
    """
    contacts, supports, session = evaluation.contacts, evaluation.supports, evaluation.session
    document = {
        **as_json(evaluation.overall),
        **_named(evaluation, "matched_frames", "truth_frames", "missing_frames", "results_frames", "drift_ratio"),
        "per_joint": dict(evaluation.per_joint),
        "per_state": dict(evaluation.per_state),
        **_named(evaluation, "observed", "hidden", "truly_seen", "truly_hidden", "confident_errors"),
        **_named(evaluation, "reported_absent_share"),
        "longest_wrong_s": {name: wrong.seconds for name, wrong in evaluation.wrong_in_view},
        "longest_wrong_from_s": {name: wrong.start_s for name, wrong in evaluation.wrong_in_view},
        "plain_view_by": "seen_share" if evaluation.view_known else "occluded",
        "angles": dict(evaluation.angles),
        "axes": dict(evaluation.axes),
        **_named(evaluation, "longest_off", "occluded_frames", "clear_frames"),
        "contacts": contacts and _contacts_json(contacts),
        "contacts_with_equipment": supports and _contacts_json(supports),
        "session": session and {**as_json(session), "events": dict(session.events)},
    }
    write_text_whole(path, json.dumps(as_json(document), indent=1, allow_nan=False) + "\n")


def _contacts_json(found: ContactEvaluation) -> dict[str, Any]:
    return {**as_json(found.overall), "per_part": dict(found.per_part), "per_state": dict(found.per_state)}


def _named(evaluation: Evaluation, *names: str) -> dict[str, Any]:
    return {name: getattr(evaluation, name) for name in names}


def contact_rows(evaluation: Evaluation) -> list[tuple[str, ...]]:
    """Return rows of text on contacts, first with people, then with equipment. The columns are: people or equipment,
    part of the body, number of frames in which it was truly touched, precision, recall. For people and for equipment, a
    row for all parts together is followed by a row for each part that was touched or reported. The list is empty if no
    contacts were evaluated.
    """
    return [
        (toucher, name.replace("_", " "), str(score.touched), *_cells((score.precision, score.recall), 100, 0))
        for toucher, contacts in (("people", evaluation.contacts), ("equipment", evaluation.supports))
        if contacts is not None
        for name, score in (("all parts", contacts.overall), *contacts.per_part)
    ]


def evaluation_rows(evaluation: Evaluation) -> list[tuple[str, ...]]:
    """Return rows of text with six columns: name of a group of joints, mean error, median error, 95th percentile of the
    error, share of lost joints, coverage. The groups are all joints, each joint, the joints in each state, all hidden
    joints, the joints that the truth calls seen or hidden, and the joints in occluded and in other frames; a group
    without a joint in any frame is left out.
    """
    groups = [
        ("all joints", evaluation.overall),
        *evaluation.per_joint,
        *evaluation.per_state,
        ("all hidden joints", evaluation.hidden),
        *([("joints seen by the truth", evaluation.truly_seen)] if evaluation.truly_seen else []),
        *([("joints hidden by the truth", evaluation.truly_hidden)] if evaluation.truly_hidden else []),
        ("frames called occluded", evaluation.occluded_frames),
        ("other frames", evaluation.clear_frames),
    ]
    return [
        (name, *_cells((s.mean_mm, s.median_mm, s.p95_mm)), *_cells((s.lost_share, s.coverage_95), 100))
        for name, s in groups
        if s.joint_frames
    ]


def angle_rows(evaluation: Evaluation) -> list[tuple[str, ...]]:
    """Return rows of text with four columns: name of an angle or axis, mean error and 95th percentile of the error in
    degrees, share of errors within 1.96 sigma.
    """
    axes = ((f"axis of {name}", error) for name, error in evaluation.axes)
    return [
        (name.replace("_", " "), *_cells((error.mean_abs_deg, error.p95_deg)), *_cells((error.coverage_95,), 100))
        for name, error in (*evaluation.angles, *axes)
        if error.frames
    ]


def event_rows(evaluation: Evaluation) -> list[tuple[str, ...]]:
    """Return rows of text, one per kind of event: how many occur in the truth; how many of these were found; how many
    were found with an onset within ``IN_TIME_S`` of the true onset; how many reported events match no true event; and
    the mean delay in s. The list is empty unless the truth is that of a simulated session.
    """
    return [
        (
            kind.replace("_", " "),
            *(str(n) for n in (s.true, s.found, s.in_time, s.false)),
            *_cells((s.late_s,), digits=3),
        )
        for kind, s in (() if evaluation.session is None else evaluation.session.events)
    ]


def independence_sentence(evaluation: Evaluation) -> str | None:
    """Return a sentence on how many measured times of independence (such as upright without a helper's hands) agree
    with the truth; None if they cannot be compared.
    """
    times = evaluation.session and evaluation.session.times
    if not times:
        return None
    return (
        "Times of independence within 1.96 sigma of the truth's, of the recording and of each trial: "
        f"{times.within} of {times.compared} ({_percent(times.within, times.compared)}); "
        f"{times.refused} have a value in only one of them."
    )


def longest_error_sentence(evaluation: Evaluation) -> str:
    """Return a sentence on the joint that was far from its true place for the longest time, if any was."""
    off = evaluation.longest_off
    if evaluation.overall.mean_mm is None:
        return "Every joint with a true position was lost in the results: no error is known."
    if off.joint is None:
        return f"No joint was ever more than {1000 * WRONG_M:.0f} mm off."
    return (
        f"The longest time in which a joint was more than {1000 * WRONG_M:.0f} mm off was {off.seconds:.2f} s: "
        f"{off.joint}, from {off.start_s:.2f} s on."
    )


def compared_sentence(evaluation: Evaluation) -> str:
    """Return a sentence on how much was compared: frames of the truth and of the results, and joints."""
    both, summary = evaluation.matched_frames, evaluation.overall
    joints = both * JOINT_COUNT
    found = round(summary.joint_frames * (1.0 - (summary.lost_share or 0.0)))
    return (
        f"Compared: {both} frames, of {evaluation.truth_frames} in the truth "
        f"({_percent(both, evaluation.truth_frames)}) and {evaluation.results_frames} in the results "
        f"({_percent(both, evaluation.results_frames)}); in them {found} of {joints} joints "
        f"({_percent(found, joints)}), the others being lost or without a true position."
    )


def _percent(part: int, whole: int) -> str:
    return f"{100 * part / whole:.3g} %" if whole else "no"


def confidence_sentences(evaluation: Evaluation) -> list[str]:
    """Return sentences on how often the result is wrong without any sign of the error in the result. The sentences are
    about confident errors, reported joints of an absent patient or limb, limbs wrong in plain view, and the share of
    coordinates within 1.96 sigma.
    """
    sentences = []
    if evaluation.confident_errors is not None:
        sentences.append(
            f"Confident errors, over {1000 * FAR_M:.0f} mm and over {CONFIDENT_SIGMAS:.0f} sigma off: "
            f"{100 * evaluation.confident_errors:.2f} % of all joints."
        )
    if evaluation.reported_absent_share is not None:
        sentences.append(
            f"Of the joints without a true position, {100 * evaluation.reported_absent_share:.2f} % are reported; a "
            "patient who is away, or a missing limb, has none."
        )
    view = (
        "while a camera saw most of it"
        if evaluation.view_known
        else "in frames not called occluded (the truth does not state what each camera saw)"
    )
    limbs = ", ".join(f"{name.replace('_', ' ')} {wrong.seconds:.2f} s" for name, wrong in evaluation.wrong_in_view)
    sentences.append(f"Longest time a limb was more than {1000 * WRONG_M:.0f} mm off {view}: {limbs}.")
    covered = [("observed", evaluation.observed.coverage_95), ("hidden", evaluation.hidden.coverage_95)]
    shares = [f"{100 * share:.1f} % of {name} joints" for name, share in covered if share is not None]
    if shares:
        sentences.append(f"Within 1.96 sigma: {', '.join(shares)}; calibrated is 95 %.")
    return sentences


def _cells(values: Iterable[float | None], times: int = 1, digits: int = 1) -> list[str]:
    return ["–" if value is None else f"{times * value:.{digits}f}" for value in values]
