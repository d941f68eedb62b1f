"""A viewer of a small recording, running; a plugin of the tests that need it."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from viewer_builder import viewer_of, write_small_session
from viewer_page import opened

from anchorpose.results.corrections import corrections_beside
from anchorpose.viewer.server import ViewerServer


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    return write_small_session(tmp_path_factory.mktemp("viewer"))


@pytest.fixture
def server(small: tuple[Path, Path]) -> Iterator[ViewerServer]:
    corrections_beside(small[0]).unlink(missing_ok=True)
    with viewer_of(*small) as running:
        yield running


@pytest.fixture
def viewer(page: Any, server: ViewerServer) -> Any:
    """The page, loaded, with the points of its first frame."""
    return opened(page, server)
