"""A report and a comparison of two; a plugin of the tests that open them."""

from typing import Any

import pytest
from report_builder import squats, write_session

from anchorpose.report.comparison import write_comparison
from anchorpose.report.page import write_report


@pytest.fixture(scope="module")
def address(tmp_path_factory: pytest.TempPathFactory) -> str:
    return write_report(write_session(tmp_path_factory.mktemp("browser") / "r", squats(120))).as_uri()


@pytest.fixture(scope="module")
def comparison(tmp_path_factory: pytest.TempPathFactory) -> str:
    folder = tmp_path_factory.mktemp("comparison")
    sessions = []
    for n in (1, 2):
        run = {"inputs_sha256": {"a": f"{n}" * 64}, "recording": f"week {n}"}
        sessions.append(write_session(folder / f"r{n}", squats(60 + 30 * n, seed=n), **run))
    return write_comparison(sessions, folder / "c.html").as_uri()


@pytest.fixture
def knee(page: Any) -> Any:
    """The part of the page about the knees' flexion."""
    return page.locator("#angle-knee_flexion")
