"""An hour's results: contacts are counted at once, and run.json may name every depth image."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from anchorpose.errors import InputError
from anchorpose.results.folder import begin_journal
from anchorpose.results.measuring import touch_of
from anchorpose.results.records import Contact
from anchorpose.results.run_record import RUN_FILE, read_run

INPUTS = {f"front/depth/{number:06d}.png": "ab" * 32 for number in range(200_000)}  # 18 MB


def test_contacts_are_counted_frame_by_frame():
    frame = np.array([3, 4, 7, 8, 9])
    first, second = contact(4, 8, 0.5), contact(5, 20, 0.75)
    touch = touch_of(frame, (first, second))
    assert touch.at_once.tolist() == [0, 1, 2, 2, 1]
    assert touch.seen.tolist() == [0.0, 0.5, 0.75, 0.75, 0.75]
    found = touch.where(np.array([True, True, False, True, True]))
    assert found.at_once.tolist() == [0, 1, 0, 2, 1]
    assert found.seen.tolist() == [0.0, 0.5, 0.0, 0.75, 0.75]


def contact(first: int, last: int, seen: float) -> Contact:
    return Contact(
        part="belly",
        person="person 1",
        first_frame=first,
        last_frame=last,
        start_s=0.0,
        end_s=1.0,
        seen_share=seen,
        area_cm2=1.0,
        gap_mm=1.0,
    )


RUN = {"format": "anchorpose-run", "version": 1, "recording": "ward 3", "cameras": []}


@pytest.mark.thorough
def test_a_run_of_an_hour_can_be_read_and_continued(tmp_path: Path):
    (tmp_path / RUN_FILE).write_text(json.dumps(RUN | {"inputs_sha256": INPUTS}))
    assert read_run(tmp_path / RUN_FILE)["inputs_sha256"] == INPUTS
    begin_journal(tmp_path, "one", INPUTS)
    begin_journal(tmp_path, "one", INPUTS)  # goes on
    with pytest.raises(InputError, match="was begun"):
        begin_journal(tmp_path, "another", INPUTS)
