"""The golden recordings of ``tools/goldens.py``, compared as its own ``check`` compares them."""

import sys
import warnings
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "tools"))

from golden_machine import fingerprint
from goldens import Absent, compare, make, other_machine, read_stored


def assert_golden(name: str, folder: Path) -> None:
    """Fails with a line per file that differs; skips where the recording is absent."""
    try:
        made = make(name, folder)
    except Absent as absent:
        pytest.skip(str(absent))
    stored, here = read_stored(), fingerprint()
    if elsewhere := other_machine(stored, here):
        warnings.warn(elsewhere, stacklevel=2)
    if found := compare(name, made, stored, here):
        pytest.fail("\n".join(found), pytrace=False)
