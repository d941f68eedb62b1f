"""Limits of agreement against published worked examples, and laws of their intervals."""

from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lfilter

from anchorpose.agreement.evaluating import PER_STRETCH, stretches
from anchorpose.agreement.statistics import limits_of_agreement

CARDIAC_OUTPUT = """
1 7.83 6.57 7.42 5.62 7.89 6.90 7.12 6.57 7.88 6.35
2 6.16 4.06 7.26 4.29 6.71 4.26 6.54 4.09
3 4.75 4.71 5.24 5.50 4.86 5.08 4.78 5.02 6.05 6.01 5.42 5.67
4 4.21 4.14 3.61 4.20 3.72 4.61 3.87 4.68 3.92 5.04
5 3.13 3.03 2.98 2.86 2.85 2.77 3.17 2.46 3.09 2.32 3.12 2.43
6 5.92 5.90 6.42 5.81 5.92 5.70 6.27 5.76
7 7.13 5.09 6.62 4.63 6.58 4.61 6.93 5.09
8 4.54 4.72 4.81 4.61 5.11 4.36 5.29 4.20 5.39 4.36 5.57 4.20
9 4.48 3.17 4.92 3.12 3.97 2.96
10 4.22 4.35 4.65 4.62 4.74 3.16 4.44 3.53 4.50 3.53
11 6.78 7.20 6.07 6.09 6.52 7.00 6.42 7.10 6.41 7.40 5.76 6.80
12 5.06 4.50 4.72 4.20 4.90 3.80 4.80 3.80 4.90 4.20 5.10 4.50
"""
"""Cardiac output by two methods in 12 patients: Bland and Altman 1999 (doi:10.1177/096228029900800204), Table 4."""


def cardiac_output() -> tuple[np.ndarray, np.ndarray]:
    """Differences (60,) and the patient of each."""
    difference, patient = list[float](), list[int]()
    for line in CARDIAC_OUTPUT.split("\n")[1:-1]:
        number, *cells = line.split()
        pairs = np.array(cells, dtype=float).reshape(-1, 2)
        difference += list(pairs[:, 0] - pairs[:, 1])
        patient += [int(number)] * len(pairs)
    return np.array(difference), np.array(patient)


def test_repeated_measurements_are_those_of_bland_and_altman_2007_to_the_printed_digit():
    found = limits_of_agreement(*cardiac_output())
    assert (found.count, found.units) == (60, 12)
    assert f"{found.bias.value:.7f}" == "0.6021667"
    assert f"{found.sd:.8f}" == "0.99062411"  # printed 0.99062408, from components rounded to eight digits
    assert f"{found.sd:.6f}" == f"{0.99062408:.6f}"
    assert (f"{found.lower.value:.6f}", f"{found.upper.value:.6f}") == ("-1.339457", "2.543790")


def blood_pressure() -> tuple[np.ndarray, np.ndarray]:
    """Systolic blood pressure, mmHg, (85, 3) each by an observer and by a machine: Bland and Altman 1999, Table 1.

    As the R package R4HCR 0.1 gives it (MIT License; NOTICE).
    """
    cells = np.loadtxt(Path(__file__).parent / "blood_pressure.csv", delimiter=",", skiprows=1)
    return cells[:, :3], cells[:, 6:]


def test_single_measurements_are_those_of_bland_and_altman_1999_to_the_printed_digit():
    """The first measurements of both in 85 subjects."""
    observer, machine = blood_pressure()
    found = limits_of_agreement(observer[:, 0] - machine[:, 0], np.arange(85))
    assert (f"{found.bias.value:.2f}", f"{found.sd:.2f}") == ("-16.29", "19.61")
    assert (f"{found.lower.value:.1f}", f"{found.upper.value:.1f}") == ("-54.7", "22.1")
    assert (f"{found.bias.low:.1f}", f"{found.bias.high:.1f}") == ("-20.5", "-12.1")
    # their interval of a limit, -61.9 to -47.5, is symmetric; recovered variances give nearly the same
    assert (found.lower.low, found.lower.high) == pytest.approx((-61.9, -47.5), abs=1.0)
    assert found.within_sd is None


def test_three_measurements_by_each_are_those_of_bland_and_altman_1999_to_the_printed_digit():
    """They are not made in pairs, so that each of the observer's goes with each of the machine's."""
    observer, machine = blood_pressure()
    assert f"{observer.var(axis=1, ddof=1).mean():.3f}" == "37.408"
    assert f"{machine.var(axis=1, ddof=1).mean():.3f}" == "83.141"
    found = limits_of_agreement((observer[:, :, None] - machine[:, None]).ravel(), np.repeat(np.arange(85), 9))
    assert (f"{found.bias.value:.2f}", f"{found.sd:.2f}") == ("-15.62", "20.95")
    assert (f"{found.lower.value:.2f}", f"{found.upper.value:.2f}") == ("-56.68", "25.44")


def test_peak_flow_is_that_of_bland_and_altman_1986_to_the_printed_digit():
    """Wright and mini meter, first measurements of 17 subjects (doi:10.1016/S0140-6736(86)90837-8)."""
    large = [494, 395, 516, 434, 476, 557, 413, 442, 650, 433, 417, 656, 267, 478, 178, 423, 427]
    small = [512, 430, 520, 428, 500, 600, 364, 380, 658, 445, 432, 626, 260, 477, 259, 350, 451]
    found = limits_of_agreement(np.array(large, float) - np.array(small, float), np.arange(17))
    assert (f"{found.bias.value:.1f}", f"{found.sd:.1f}") == ("-2.1", "38.8")
    assert (f"{found.bias.low:.1f}", f"{found.bias.high:.1f}") == ("-22.0", "17.8")


def test_intervals_hold_the_true_limits_95_times_in_100():
    """20 units of 15 differences, standard deviation 3 between and 2 within: the limits are known."""
    rng, inside, repeats = np.random.default_rng(4), np.zeros(3), 400
    truth = 1.0 + 1.96 * np.hypot(3.0, 2.0) * np.array([0.0, -1.0, 1.0])
    unit = np.repeat(np.arange(20), 15)
    for _ in range(repeats):
        found = limits_of_agreement(1.0 + 3.0 * rng.normal(size=20)[unit] + 2.0 * rng.normal(size=300), unit)
        ends = (found.bias, found.lower, found.upper)
        inside += [each.low <= true <= each.high for each, true in zip(ends, truth, strict=True)]
    assert (inside / repeats > 0.91).all(), inside / repeats
    assert (inside / repeats < 0.99).all(), inside / repeats


def test_intervals_hold_the_true_limits_if_the_errors_of_a_subject_last_for_seconds():
    """20 subjects, each recorded for a minute at 4 Hz, with errors that are correlated for 4 s."""
    rng, inside, repeats, kept = np.random.default_rng(1), np.zeros(2), 200, np.exp(-1.0 / 16.0)
    truth = 1.96 * np.hypot(1.0, 3.0) * np.array([-1.0, 1.0])
    subject, time_s = np.repeat(np.arange(20), 240), np.arange(240) / 4.0
    for _ in range(repeats):
        noise = rng.normal(size=(20, 240)) * np.sqrt(1.0 - kept**2)
        noise[:, 0] = rng.normal(size=20)
        errors = 3.0 * lfilter([1.0], [1.0, -kept], noise) + rng.normal(size=(20, 1))
        independent = PER_STRETCH * sum(len(np.unique(stretches(time_s, one))) for one in errors)
        found = limits_of_agreement(errors.ravel(), subject, independent)
        inside += [each.low <= true <= each.high for each, true in zip((found.lower, found.upper), truth, strict=True)]
    assert (inside / repeats > 0.93).all(), inside / repeats
    assert (inside / repeats < 0.99).all(), inside / repeats


def test_few_units_give_limits_without_an_interval():
    found = limits_of_agreement(np.array([1.0, 2.0, 3.0, 5.0]), np.array([0, 0, 1, 1]))
    assert found.lower.low is None
    assert found.lower.value < found.bias.value < found.upper.value
    alone = limits_of_agreement(np.array([1.0, 2.0, 3.0]), np.zeros(3))
    assert (alone.between_sd, alone.sd) == (None, 1.0)
    with pytest.raises(ValueError, match="1 differences"):
        limits_of_agreement(np.ones(1), np.ones(1))
