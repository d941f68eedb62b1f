"""The settings that were tried on the training recordings, and which were chosen."""

from __future__ import annotations

import csv
import io

from anchorpose.experiments.outcome import Outcome, Tried

SETTINGS_KEY = "settings"


def tried_settings(outcome: Outcome) -> list[tuple[str, Tried]]:
    """(title of the method, setting), method by method, the best first."""
    titles = {method.key: method.title for method in outcome.methods}
    return [
        (titles.get(key, key), one)
        for key, tried in outcome.tried
        for one in sorted(tried, key=lambda one: (not one.chosen, one.score_mm))
    ]


def settings_csv(outcome: Outcome) -> str:
    """One line a setting."""
    out = io.StringIO()
    lines = csv.writer(out, lineterminator="\n")
    lines.writerow(["method", "setting", "score_mm", "chosen"])
    for key, tried in outcome.tried:
        for one in tried:
            score = "" if one.score_mm != one.score_mm else f"{one.score_mm:.6g}"
            lines.writerow([key, one.setting, score, "yes" if one.chosen else "no"])
    return out.getvalue()
