"""Where compiled kernels are kept if neither the package's folder nor the user's cache folder can be written."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

import anchorpose

IMPORT = """
import os, sys
os.access = lambda path, mode: {writable}
import anchorpose
assert "numba" not in sys.modules
print(os.environ.get("NUMBA_CACHE_DIR", ""))
"""
KERNEL = """
from numba import njit

@njit(cache=True)
def twice(number: int) -> int:
    return 2 * number
"""


def run(folder: Path, script: str, **variables: str) -> str:
    """Run a script without a home, with ``folder`` as the folder of temporary files; return what it prints."""
    environment = {key: each for key, each in os.environ.items() if key not in ("NUMBA_CACHE_DIR", "XDG_CACHE_HOME")}
    paths = os.pathsep.join((str(Path(anchorpose.__file__).parents[1]), str(folder)))
    given = {"HOME": "/proc/none", "TMPDIR": str(folder), "PYTHONPATH": paths, "PYTHONDONTWRITEBYTECODE": "1"}
    command = [sys.executable, "-c", script]
    return subprocess.run(
        command, env=environment | given | variables, check=True, capture_output=True, text=True
    ).stdout.strip()


def test_without_a_writable_folder_kernels_are_kept_in_a_folder_of_the_user(tmp_path):
    found = Path(run(tmp_path, IMPORT.format(writable=False)))
    assert found.parent == tmp_path
    assert found.stat().st_mode & 0o777 == 0o700
    assert run(tmp_path, IMPORT.format(writable=False)) == str(found)


def test_a_writable_folder_or_the_choice_of_the_user_is_left_alone(tmp_path):
    assert run(tmp_path, IMPORT.format(writable=True)) == ""
    assert run(tmp_path, IMPORT.format(writable=False), NUMBA_CACHE_DIR="mine") == "mine"
    assert list(tmp_path.iterdir()) == []


@pytest.mark.skipif(sys.platform == "win32", reason="temporary files are the user's own there")
def test_a_folder_that_others_can_write_is_not_used(tmp_path):
    """Whoever can put a kernel there runs code as this user."""
    planted = Path(run(tmp_path, IMPORT.format(writable=False)))
    planted.chmod(0o777)
    found = Path(run(tmp_path, IMPORT.format(writable=False)))
    assert found != planted
    assert found.stat().st_mode & 0o777 == 0o700


@pytest.mark.skipif(sys.platform != "linux", reason="/proc is a folder in which nobody can write")
def test_kernels_can_be_imported_where_nothing_can_be_written(tmp_path):
    (tmp_path / "kernel.py").write_text(KERNEL)
    (tmp_path / "__pycache__").write_text("so that numba cannot write here")
    script = f"{IMPORT.format(writable=False)}from kernel import twice; print(twice(21))"
    assert run(tmp_path, script).endswith("42")
