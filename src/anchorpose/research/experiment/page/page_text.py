"""Write the texts of the page: summary, what was run, which settings were tried, limits, and how to run it again."""

from __future__ import annotations

import csv
import dataclasses
import io
from collections import Counter
from collections.abc import Sequence
from html import escape
from typing import Any, Final

from anchorpose.research.experiment.config import ExperimentConfig, Scene, Update
from anchorpose.research.experiment.method import NEXT, PROPOSED, Family
from anchorpose.research.experiment.page.page_parts import best_of, text_table
from anchorpose.research.experiment.page.selection import left_out
from anchorpose.research.experiment.page.tables import Table, format_estimate
from anchorpose.research.experiment.page.verdict import Claim, Verdict
from anchorpose.research.experiment.results import ExperimentResults, TriedSetting

SETTINGS_KEY = "settings"


def tried_settings(results: ExperimentResults) -> list[tuple[str, TriedSetting]]:
    """Return each tried setting with the title of its method, method by method, the chosen setting first."""
    titles = {method.key: method.title for method in results.methods}
    return [
        (titles.get(key, key), one)
        for key, tried in results.tried
        for one in sorted(tried, key=lambda one: (not one.chosen, one.score_mm))
    ]


def settings_csv(results: ExperimentResults) -> str:
    """Return the tried settings as CSV, one line per setting."""
    out = io.StringIO()
    lines = csv.writer(out, lineterminator="\n")
    lines.writerow(["method", "setting", "score_mm", "chosen"])
    for key, tried in results.tried:
        for one in tried:
            score = "" if one.score_mm != one.score_mm else f"{one.score_mm:.6g}"
            lines.writerow([key, one.setting, score, "yes" if one.chosen else "no"])
    return out.getvalue()


LIMITS: Final = (
    "The recordings are simulated, except in the scene “real”: bodies, clothes, movements and a Kinect v2’s noise and "
    "edges come from this project’s simulator, whose body model the trackers also fit. Real people and sensors differ.",
    "The truth of simulated recordings is exact. That of real ones is the skeleton of another tracker, with its own "
    "errors.",
    "Each method is given the body, the pose before it starts, and which pixels are the patient’s, as this project’s "
    "tracker found them on the recording without holes; the paper takes them from the sensor’s own tracker. Only "
    "anchorpose’s tracker finds all three itself, on the recording with holes.",
    "Matches are compared in a few pairs of frames of each recording, over nodes whose place is seen in both.",
    "Intervals are by a bootstrap over recordings, widened by Student’s distribution for their small number. They are "
    "valid for recordings like these.",
    "Reference movements are the simulator’s joints; the paper’s are those of the sensor’s skeleton.",
    "Methods are tuned by their matches after the track tree, which the framework uses; matches are also shown without "
    "the tree, as in the paper.",
    "Rejection (a node is given up 10 cm off its prediction, a part’s motion is fitted with Cauchy’s weights) is not "
    "in the paper; the tables by form show every method with and without it.",
    "The rule of the verdicts was written down before this run. In the run that was published first, a claim held in "
    "part only if at least half of its comparisons answered yes; “local features are accurate only at distinctive "
    "places” was judged by the joints at head and neck, which the surface corrects, and is judged by matches now.",
    "Intervals are not corrected for the number of comparisons: of a hundred without a true difference, about five "
    "seem to show one.",
    "anchorpose’s tracker uses earlier and later frames and is not part of the paper’s framework: its values show what "
    "is possible, not which feature is best.",
)


def summary_html(results: ExperimentResults, claims: Sequence[Claim], tables: Sequence[Table]) -> str:
    """Return, as HTML, the number of claims with each verdict, and the errors of the best methods."""
    counts = Counter(claim.verdict for claim in claims)
    verdicts = ", ".join(
        f"{counts[verdict]} {_plural(verdict, counts[verdict])}" for verdict in Verdict if counts[verdict]
    )
    return f"<p>{escape(f'Of {len(claims)} claims, {verdicts}.')}</p>{_errors(results, tables)}"


def _plural(verdict: Verdict, count: int) -> str:
    words = {Verdict.HOLDS: "hold", Verdict.IN_PART: "hold in part", Verdict.NOT: "do not hold"}
    return str(verdict) if count == 1 else words.get(verdict, str(verdict))


def _errors(results: ExperimentResults, tables: Sequence[Table]) -> str:
    """Return as HTML the joint errors of the proposed method, of the method "next generation" (anchors with the local
    descriptor SHOT), and of each other family's best method.

    The best method of a family is the method with the smallest mean error at the largest hole.
    """
    errors = next((table for table in tables if table.key == "result1"), None)
    if errors is None:
        return ""
    first, last = errors.columns[0], errors.columns[-1]
    others = (_best(errors, last.key, family) for family in Family if family is not Family.PROPOSED)
    chosen = [PROPOSED, NEXT, *others]
    lines = [
        f"{method.title}: {format_estimate(errors.value(method.key, first.key), first.unit)} and "
        f"{format_estimate(errors.value(method.key, last.key), last.unit)}"
        for key in chosen
        for method in errors.methods
        if method.key == key
    ]
    listed = "".join(f"<li>{escape(line)}</li>" for line in lines)
    where = f"without a hole and with one of {last.label}" if first != last else "without a hole"
    what = f"Mean joint errors in mm, {where}, same frames, of the proposed feature and the best of each kind:"
    return f"<p>{escape(what)}</p><ul>{listed}</ul>"


def _best(errors: Table, column: str, family: Family) -> str | None:
    return best_of(
        errors, column, [one.key for one in errors.methods if one.family is family and one.update is Update.PARTS]
    )


def run_html(results: ExperimentResults) -> str:
    """Return a description of the run as HTML: recordings, holes, methods with their sources, and the choice of
    settings.
    """
    config = results.config
    others = ", ".join(scene for scene in config.scenes if scene is not Scene.PAPER)
    holes = ", ".join(f"{hole:g} m" for hole in config.holes_m if hole)
    facts = [
        f"{config.recordings} simulated recordings of {config.seconds:g} s at {config.fps:g} frames per second, each "
        "of another body with other clothes and movements, one front camera. Holes around the body’s centre of radius "
        f"{holes or 'none'}, in {100 * config.hole_share:.0f} % of the frames, drawn at random.",
        f"Tracking restarts every {config.segment_frames} frames. Every method ran on the same {config.segments} of "
        f"these segments of each recording, drawn at random: {_frames(config)} frames for each size of hole.",
        f"Matches are compared at {config.windows} moments of each recording, size of hole and gap between the two "
        f"frames ({', '.join(f'{gap:g}' for gap in config.gaps_s)} s).",
        f"Other scenes: {others or 'none'}; {config.scene_recordings} recordings of {config.scene_seconds:g} s each.",
        f"Reference movements: {config.training_samples} frames of other recordings.",
    ]
    lost, segments = left_out(results)
    if lost:
        facts.append(
            f"{lost} of the {segments} segments of the simulated recordings were left out for all methods: the "
            "tracker that gives the initial pose had lost the patient there."
        )
    if results.real is not None:
        facts.append(
            f"Real recordings: the folder {results.real.name}. Intervals assume that each recording is of "
            "another person; where several are of one, they are too narrow."
        )
    listed = "".join(f"<li>{escape(fact)}</li>" for fact in facts)
    failed = "".join(f"<li>{escape(sentence)}</li>" for sentence in results.failed)
    unused = f"<p class='missing'>Not used:</p><ul>{failed}</ul>" if failed else ""
    return f"<ul>{listed}</ul>{unused}{_methods(results)}{_settings(results)}"


def _frames(config: ExperimentConfig) -> int:
    return (config.segment_frames - 1) * config.segments_of(Scene.PAPER) * config.recordings


def _methods(results: ExperimentResults) -> str:
    rows = [(method.title, method.family, method.source or "this project") for method in results.methods]
    return text_table("Methods", ("method", "kind", "source"), rows)


def _settings(results: ExperimentResults) -> str:
    if not results.tried:
        return "<p>No settings were tried: every method ran with its first setting.</p>"
    rows = [
        (title, one.setting, f"{one.score_mm:.1f}", "chosen" if one.chosen else "")
        for title, one in tried_settings(results)
    ]
    what = (
        f"Settings were chosen on {results.config.training_recordings} training recordings that are not used for "
        "testing: for each method the setting with the smallest mean distance of matches from the truth, where a node "
        "without a match counts as a bad match."
    )
    table = text_table("Settings tried, the chosen first", ("method", "setting", "mean distance (mm)", ""), rows)
    return f"<p>{escape(what)}</p><details><summary>Settings tried</summary>{table}</details>"


def limits_html(results: ExperimentResults) -> str:
    """Return the limits of these results (``LIMITS``, and the short duration of a segment) as HTML."""
    config = results.config
    seconds = (config.segment_frames - 1) / config.fps
    own = f"A segment lasts {seconds:.2g} s: slower drift is not visible."
    return f"<ul>{''.join(f'<li>{escape(line)}</li>' for line in (*LIMITS[:3], own, *LIMITS[3:]))}</ul>"


def again_html(results: ExperimentResults) -> str:
    """Return the command that repeats the run, and the text of the configuration file that it reads, as HTML."""
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
