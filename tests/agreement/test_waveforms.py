"""Correlation of waveforms and calibration of sigma: known answers and laws."""

import numpy as np
import pytest

from anchorpose.agreement.statistics import calibration_error, coverage_95, waveform_correlation

WAVE = np.sin(np.linspace(0, 6 * np.pi, 400))


def test_equal_waveforms_correlate_perfectly_and_an_offset_or_a_gain_lowers_it():
    assert waveform_correlation(WAVE, WAVE) == pytest.approx(1.0)
    assert waveform_correlation(WAVE, 0.8 * WAVE) < 1.0
    near, far = (waveform_correlation(WAVE, WAVE + shift) for shift in (0.2, 0.8))
    assert 1.0 > near > far


def test_the_correlation_is_the_formula_by_hand():
    """1 and 3 against 1 and 1, repeated: within 2/2... by sums over a loop."""
    a, b = np.tile([1.0, 3.0, 2.0, 5.0], 5), np.tile([1.5, 2.0, 2.0, 4.0], 5)
    above = sum((x - (x + y) / 2) ** 2 + (y - (x + y) / 2) ** 2 for x, y in zip(a, b, strict=True)) / (len(a) * 1)
    mean = np.concatenate([a, b]).mean()
    below = sum((x - mean) ** 2 for x in [*a, *b]) / (2 * len(a) - 1)
    assert waveform_correlation(a, b) == pytest.approx(np.sqrt(1 - above / below))


def test_curves_that_differ_by_more_than_they_move_have_none():
    assert waveform_correlation(0.1 * WAVE, 0.1 * WAVE + 5.0) is None
    assert waveform_correlation(WAVE[:5], WAVE[:5]) is None
    assert waveform_correlation(np.ones(50), np.ones(50)) is None


def test_right_sigmas_cover_and_wrong_ones_are_found():
    error = np.random.default_rng(2).normal(size=40000)
    assert coverage_95(error, np.ones(40000)) == pytest.approx(0.95, abs=0.005)
    assert calibration_error(error, np.ones(40000)) < 0.005
    assert calibration_error(error, np.full(40000, 0.5)) > 0.15
    assert calibration_error(error, np.full(40000, 1e6)) == pytest.approx(0.5, abs=0.01)
