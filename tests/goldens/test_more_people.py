"""What recordings with several people are tracked to, byte for byte (``goldens_builder``)."""

import pytest
from goldens_builder import assert_golden

pytestmark = pytest.mark.thorough


@pytest.mark.parametrize("name", ["clinic", "bars", "room"])
def test_results_have_not_changed(name, tmp_path):
    assert_golden(name, tmp_path)
