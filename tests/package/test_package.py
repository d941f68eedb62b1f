"""What the sdist and the wheel hold: everything that the program reads at run time, and nothing else."""

import subprocess
import sys
import tarfile
import zipfile
from email import message_from_bytes
from pathlib import Path

import pytest

from anchorpose import __version__

pytest.importorskip("hatchling")
pytestmark = pytest.mark.thorough

ROOT = Path(__file__).parents[2]
SOURCE = ROOT / "src"


def build(target: str, source: Path, folder: Path) -> Path:
    """Build the sdist or the wheel of a source tree."""
    command = [sys.executable, "-m", "hatchling", "build", "-t", target, "-d", str(folder)]
    subprocess.run(command, cwd=source, check=True, capture_output=True)
    (built,) = folder.iterdir()
    return built


@pytest.fixture(scope="module")
def unpacked(tmp_path_factory) -> Path:
    """The sdist, unpacked."""
    folder = tmp_path_factory.mktemp("sdist")
    with tarfile.open(build("sdist", ROOT, folder / "built")) as archive:
        archive.extractall(folder, filter="data")
    return folder / f"anchorpose-{__version__}"


@pytest.fixture(scope="module")
def wheel(unpacked, tmp_path_factory) -> zipfile.ZipFile:
    """The wheel that is built of the sdist."""
    return zipfile.ZipFile(build("wheel", unpacked, tmp_path_factory.mktemp("wheel") / "built"))


def test_the_wheel_holds_every_file_of_the_package_and_nothing_else(wheel):
    files = {path.relative_to(SOURCE).as_posix() for path in (SOURCE / "anchorpose").rglob("*") if path.is_file()}
    files = {name for name in files if "__pycache__" not in name}
    about = f"anchorpose-{__version__}.dist-info/"
    assert {name for name in wheel.namelist() if not name.startswith(about)} == files
    assert {"anchorpose/py.typed", "anchorpose/__init__.pyi"} <= files
    assert {f"{about}licenses/LICENSE", f"{about}licenses/NOTICE"} <= set(wheel.namelist())


def test_data_files_are_as_in_the_repository(wheel):
    for name in ("body/data/body.npz", "descriptor/data/learnt.weights", "report/templates/page.html"):
        assert wheel.read(f"anchorpose/{name}") == (SOURCE / "anchorpose" / name).read_bytes()


def test_the_wheel_states_what_it_needs_and_starts_the_command_line(wheel):
    about = f"anchorpose-{__version__}.dist-info"
    stated = message_from_bytes(wheel.read(f"{about}/METADATA"))
    assert stated["Version"] == __version__
    assert stated["License-Expression"] == "Apache-2.0"
    needed = [line for line in stated.get_all("Requires-Dist") if "extra ==" not in line]
    assert {"numpy>=2.1", "numba>=0.61"} <= set(needed)
    assert not any(line.startswith(("pytest", "sphinx")) for line in needed)
    assert b"anchorpose = anchorpose.cli:main" in wheel.read(f"{about}/entry_points.txt")


def test_the_commands_of_the_readme_work_in_the_sdist(unpacked):
    for name in (
        "README.md",
        "pyproject.toml",
        "requirements.lock",
        "requirements-dev.lock",
        "CITATION.cff",
        "LICENSE",
    ):
        assert (unpacked / name).read_bytes() == (ROOT / name).read_bytes()
    assert (unpacked / "tests" / "conftest.py").is_file()
