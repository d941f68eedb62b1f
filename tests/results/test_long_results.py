"""An hour's results: contacts are counted at once, and run.json may name every depth image."""

import json
from pathlib import Path

import pytest

from anchorpose.errors import InputError
from anchorpose.results.run_record import RUN_FILE, read_run
from anchorpose.results.unfinished import begin_journal

INPUTS = {f"front/depth/{number:06d}.png": "ab" * 32 for number in range(200_000)}  # 18 MB


RUN = {"format": "anchorpose-run", "version": 1, "recording": "ward 3", "cameras": []}


@pytest.mark.thorough
def test_a_run_of_an_hour_can_be_read_and_continued(tmp_path: Path):
    (tmp_path / RUN_FILE).write_text(json.dumps(RUN | {"inputs_sha256": INPUTS}))
    assert read_run(tmp_path / RUN_FILE)["inputs_sha256"] == INPUTS
    begin_journal(tmp_path, "one", INPUTS)
    begin_journal(tmp_path, "one", INPUTS)  # goes on
    with pytest.raises(InputError, match="was begun"):
        begin_journal(tmp_path, "another", INPUTS)
