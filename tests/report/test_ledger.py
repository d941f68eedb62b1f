"""Numbers of a page are the same whether a table is in memory already or is read from its file."""

from __future__ import annotations

from pathlib import Path

import pytest
from report_builder import squats, write_session

from anchorpose.report.ledger import Aggregation, Ledger, Rows
from anchorpose.report.session import read_session
from anchorpose.results.tables import ANGLES_FILE, JOINTS_FILE

HEAD = (("joint", "Head"),)
BEND = (("angle", "knee_flexion_left"),)


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_session(tmp_path_factory.mktemp("ledger") / "results", squats(60))


@pytest.mark.parametrize(
    ("rows", "aggregation"),
    [
        (Rows(JOINTS_FILE), Aggregation(column="frame", how="distinct")),
        (Rows(JOINTS_FILE), Aggregation(column="state", how="count")),
        (Rows(JOINTS_FILE), Aggregation(column="state", how="share", among=("observed",))),
        (Rows(JOINTS_FILE), Aggregation(column="state", how="frames", among=("observed",))),
        (Rows(JOINTS_FILE), Aggregation(column="sigma_m", how="median")),
        (Rows(JOINTS_FILE), Aggregation(column="time_s", how="extent")),
        (Rows(JOINTS_FILE, HEAD), Aggregation(column="state", how="share", among=("lost",))),
        (Rows(JOINTS_FILE, HEAD), Aggregation(column="y_m", how="highest")),
        (Rows(JOINTS_FILE, HEAD), Aggregation(column="frame", how="distinct")),
        (Rows(ANGLES_FILE, BEND), Aggregation(column="degrees", how="lowest")),
        (Rows(ANGLES_FILE, BEND), Aggregation(column="sigma_deg", how="median")),
        (Rows(ANGLES_FILE, (("frame", "3"),)), Aggregation(column="degrees", how="highest")),
    ],
)
def test_a_table_in_memory_and_its_file_give_the_same_number(results: Path, rows, aggregation):
    read = read_session(results).ledger.take(rows, aggregation)
    assert read is not None
    assert read == Ledger(results).take(rows, aggregation)
