"""What one camera's recordings are tracked to, byte for byte (``goldens_builder``); a file of its own, for speed."""

import pytest
from goldens_builder import assert_golden

THOROUGH = [pytest.param(name, marks=pytest.mark.thorough) for name in ("hole", "front", "filtered", "msr")]


@pytest.mark.parametrize("name", ["single", *THOROUGH])
def test_results_have_not_changed(name, tmp_path):
    assert_golden(name, tmp_path)
