"""How all tests run: the same examples everywhere, no time limit that a first compilation would break; a browser."""

import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Final

import pytest
from hypothesis import settings

settings.register_profile("same everywhere", derandomize=True, deadline=None)
settings.load_profile("same everywhere")


COMPILES_MOST: Final = ("test_pipeline.py",)
COMPILE_LITTLE: Final = ("report", "exports", "cli", "recording", "viewer", "test_docs.py", "test_structure.py")
LONG: Final = (
    "research",
    "tracker",
    "goldens",
    "test_real_recordings.py",
)  # not at the end, where other workers would wait


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """One worker compiles the kernels of tracking first, while the others run what needs few of them.

    Otherwise every worker compiles them all, since a kernel is in the cache only once it has been compiled. A slow test
    in a module of thorough ones stays slow.
    """
    if config.option.markexpr == "thorough":
        config.hook.pytest_deselected(items=[item for item in items if item.get_closest_marker("slow")])
        items[:] = [item for item in items if not item.get_closest_marker("slow")]

    def turn(item: pytest.Item) -> int:
        place = item.path.relative_to(Path(__file__).parent).parts[0]
        return next((k for k, group in enumerate((COMPILES_MOST, COMPILE_LITTLE, LONG)) if place in group), 3)

    items.sort(key=turn)


@pytest.fixture
def refusal(capsys: pytest.CaptureFixture[str]) -> Callable[[list[str]], str]:
    """What the command writes on the error stream where it refuses its arguments."""

    def refused(arguments: list[str]) -> str:
        from anchorpose.cli import main

        assert main(arguments) == 2
        return capsys.readouterr().err

    return refused


@pytest.fixture(scope="session")
def chromium() -> Iterator[Any]:
    """The Chromium of this machine, driven by playwright; without one, tests of pages skip."""
    program = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
    if program is None:
        pytest.skip("there is no Chromium on this machine")
    sync_api = pytest.importorskip("playwright.sync_api")
    with sync_api.sync_playwright() as playwright:
        # no sandbox: CI runs as root; WebGL by software: CI has no graphics card
        browser = playwright.chromium.launch(
            executable_path=program, args=["--no-sandbox", "--enable-unsafe-swiftshader"]
        )
        yield browser
        browser.close()


@pytest.fixture
def page(chromium: Any) -> Iterator[Any]:
    """A page that reaches files and this machine only; the test fails where it wrote an error or asked for more."""
    context = chromium.new_context(viewport={"width": 1280, "height": 800})
    page, errors = context.new_page(), list[str]()
    page.on("console", lambda message: errors.append(message.text) if message.type == "error" else None)
    page.on("pageerror", lambda error: errors.append(str(error)))

    def only_here(route: Any) -> None:
        if route.request.url.startswith(("file:", "data:", "blob:", "http://127.0.0.1:", "http://localhost:")):
            route.continue_()
        else:
            errors.append(f"asked for {route.request.url}")
            route.abort()

    context.route("**/*", only_here)
    yield page
    context.close()
    assert errors == []
