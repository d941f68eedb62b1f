"""What one camera's recordings are tracked to, byte for byte (``goldens_builder``); a file of its own, for speed."""

from __future__ import annotations

import pytest
from goldens_builder import assert_golden


@pytest.mark.parametrize("name", ["single", "hole", "front", "filtered", "msr"])
def test_results_have_not_changed(name, tmp_path):
    assert_golden(name, tmp_path)
