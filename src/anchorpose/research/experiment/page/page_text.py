"""What the page says in words: the summary, what was run, the limits, how to run it again.

The settings that were tried on the training recordings, and which were chosen.
"""

from __future__ import annotations

import csv
import dataclasses
import io
from collections import Counter
from collections.abc import Sequence
from html import escape
from typing import Any, Final

from anchorpose.research.experiment.config import ExperimentConfig, Scene
from anchorpose.research.experiment.method import PROPOSED, Family
from anchorpose.research.experiment.page.page_parts import best_of, text_table
from anchorpose.research.experiment.page.selection import left_out
from anchorpose.research.experiment.page.tables import Table, format_estimate
from anchorpose.research.experiment.page.verdict import Claim, Verdict
from anchorpose.research.experiment.results import ExperimentResults, TriedSetting

SETTINGS_KEY = "settings"


def tried_settings(results: ExperimentResults) -> list[tuple[str, TriedSetting]]:
    """(title of the method, setting), method by method, the best first."""
    titles = {method.key: method.title for method in results.methods}
    return [
        (titles.get(key, key), one)
        for key, tried in results.tried
        for one in sorted(tried, key=lambda one: (not one.chosen, one.score_mm))
    ]


def settings_csv(results: ExperimentResults) -> str:
    """One line a setting."""
    out = io.StringIO()
    lines = csv.writer(out, lineterminator="\n")
    lines.writerow(["method", "setting", "score_mm", "chosen"])
    for key, tried in results.tried:
        for one in tried:
            score = "" if one.score_mm != one.score_mm else f"{one.score_mm:.6g}"
            lines.writerow([key, one.setting, score, "yes" if one.chosen else "no"])
    return out.getvalue()


LIMITS: Final = (
    "The recordings are simulated, but for the scene “real”: bodies, clothes, movements and a Kinect v2’s noise and "
    "edges come from this project’s simulator, whose body asset the trackers also fit. Real people and sensors differ.",
    "The truth of simulated recordings is exact. That of real ones is the skeleton of another tracker, with its own "
    "errors.",
    "Each method starts from a pose that this project’s tracker found on the recording before holes were cut, and with "
    "the body that it learnt there, as the paper takes them from the sensor’s own tracker. No method finds a first "
    "pose by itself, but the own tracker.",
    "Matches are compared in a few pairs of neighbouring frames of each recording, over nodes whose place is seen in "
    "both.",
    "Intervals come from drawing recordings again, widened as Student’s distribution asks for few of them. They hold "
    "for recordings like these.",
    "Reference movements are the simulator’s own joints, where the paper has those of the sensor’s skeleton.",
    "Methods are tuned by their matches after the track tree, which the framework uses; matches are then also shown as "
    "the paper shows them, without the tree.",
    "Many comparisons are made, and no interval is widened for that: of a hundred without a difference some five look "
    "as if they had one.",
    "The own tracker looks at frames before and after and is not made for the paper’s framework: its figures say how "
    "far one can come, not which feature is best.",
)


def summary_html(results: ExperimentResults, claims: Sequence[Claim], tables: Sequence[Table]) -> str:
    """One sentence on the claims and one on the errors."""
    counts = Counter(claim.verdict for claim in claims)
    said = ", ".join(f"{counts[verdict]} {_plural(verdict, counts[verdict])}" for verdict in Verdict if counts[verdict])
    return f"<p>{escape(f'Of {len(claims)} claims, {said}.')}</p>{_errors(results, tables)}"


def _plural(verdict: Verdict, count: int) -> str:
    words = {Verdict.HOLDS: "hold", Verdict.IN_PART: "hold in part", Verdict.NOT: "do not hold"}
    return str(verdict) if count == 1 else words.get(verdict, str(verdict))


def _errors(results: ExperimentResults, tables: Sequence[Table]) -> str:
    """The proposed method and the best of each other kind with the largest hole."""
    errors = next((table for table in tables if table.key == "result1_same_frames"), None)
    if errors is None:
        return ""
    first, last = errors.columns[0], errors.columns[-1]
    chosen = [PROPOSED, *(_best(errors, last.key, family) for family in Family if family is not Family.PROPOSED)]
    lines = [
        f"{method.title}: {format_estimate(errors.value(method.key, first.key), first.unit)} and "
        f"{format_estimate(errors.value(method.key, last.key), last.unit)}"
        for key in chosen
        for method in errors.methods
        if method.key == key
    ]
    listed = "".join(f"<li>{escape(line)}</li>" for line in lines)
    where = f"without a hole and with one of {last.label}" if first != last else "without a hole"
    what = f"Mean joint errors in mm, {where}, all on the same frames; the proposed feature, and the best of each kind:"
    return f"<p>{escape(what)}</p><ul>{listed}</ul>"


def _best(errors: Table, column: str, family: Family) -> str | None:
    return best_of(errors, column, [method.key for method in errors.methods if method.family is family])


def run_html(results: ExperimentResults) -> str:
    """Recordings, holes, methods with their sources, and how settings were chosen."""
    config = results.config
    others = ", ".join(scene for scene in config.scenes if scene is not Scene.PAPER)
    holes = ", ".join(f"{hole:g} m" for hole in config.holes_m if hole)
    facts = [
        f"{config.recordings} simulated recordings of {config.seconds:g} s at {config.fps:g} frames per second, each "
        "of another body in other clothes and movements, one front camera. Holes about the body’s centre of radius "
        f"{holes or 'none'}, in {100 * config.hole_share:.0f} % of the frames, drawn at random.",
        f"Tracking starts anew every {config.segment_frames} frames. Methods that are marked as sampled ran on "
        f"{config.sampled_segments} of these segments of each of {min(config.sampled_recordings, config.recordings)} "
        "recordings, drawn at random; comparisons use the frames that all of the compared methods ran on: "
        f"{_sample_frames(config)} for each size of hole.",
        f"Other scenes: {others or 'none'}; {config.scene_recordings} recordings of {config.scene_seconds:g} s each.",
        f"Reference movements: {config.training_samples} frames of other recordings.",
    ]
    lost, segments = left_out(results)
    if lost:
        facts.append(
            f"{lost} of the {segments} segments of the simulated recordings were left out, for all methods: the "
            "tracker that they start from had lost the patient there."
        )
    if results.real is not None:
        facts.append(
            f"Real recordings: the folder {results.real.name}. Intervals take each recording for another person’s; "
            "where several are of one, they are too narrow."
        )
    listed = "".join(f"<li>{escape(fact)}</li>" for fact in facts)
    failed = "".join(f"<li>{escape(sentence)}</li>" for sentence in results.failed)
    unused = f"<p class='missing'>Not used:</p><ul>{failed}</ul>" if failed else ""
    return f"<ul>{listed}</ul>{unused}{_methods(results)}{_settings(results)}"


def _sample_frames(config: ExperimentConfig) -> int:
    return (config.segment_frames - 1) * config.sampled_segments * min(config.sampled_recordings, config.recordings)


def _methods(results: ExperimentResults) -> str:
    rows = [
        (method.title, method.family, "sampled" if method.sampled else "all", method.source or "this project")
        for method in results.methods
    ]
    return text_table("Methods", ("method", "kind", "frames", "source"), rows)


def _settings(results: ExperimentResults) -> str:
    if not results.tried:
        return "<p>No settings were tried: every method ran with its first.</p>"
    rows = [
        (title, one.setting, f"{one.score_mm:.1f}", "chosen" if one.chosen else "")
        for title, one in tried_settings(results)
    ]
    what = (
        f"Settings were chosen on {results.config.training_recordings} training recordings, which nothing is tested on:"
        " for each method the setting of its grid with the smallest mean distance of matches from the truth, a node "
        "without a match counting as a bad one."
    )
    table = text_table("Settings tried, the chosen first", ("method", "setting", "mean distance (mm)", ""), rows)
    return f"<p>{escape(what)}</p><details><summary>Settings tried</summary>{table}</details>"


def limits_html(results: ExperimentResults) -> str:
    """What these figures cannot say."""
    config = results.config
    seconds = (config.segment_frames - 1) / config.fps
    own = f"A segment is followed for {seconds:.2g} s: what drifts slower than that is not seen."
    return f"<ul>{''.join(f'<li>{escape(line)}</li>' for line in (*LIMITS[:3], own, *LIMITS[3:]))}</ul>"


def again_html(results: ExperimentResults) -> str:
    """The command, and the configuration as the file that it reads."""
    real = " --real FOLDER" if results.real is not None else ""
    lines = [
        f"{field.name} = {_toml(getattr(results.config, field.name))}" for field in dataclasses.fields(results.config)
    ]
    return (
        f"<pre>anchorpose experiment OUT --config experiment.toml{real}</pre><p>with experiment.toml:</p>"
        f"<pre>{escape(chr(10).join(lines))}</pre>"
    )


def _toml(value: Any) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, tuple):
        return f"[{', '.join(map(_toml, value))}]"
    if isinstance(value, str):
        return '"' + value.replace("\\", "\\\\").replace('"', '\\"') + '"'
    return repr(value)
