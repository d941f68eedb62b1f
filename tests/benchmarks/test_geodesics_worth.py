"""The comparison of geodesics with doing without: what is counted, and differences pair by pair."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "benchmarks"))

from geodesics_worth import SITUATIONS, VARIANTS
from paired_variants import ALWAYS, GEODESIC, MISSING_MM, NEITHER, POSITION, compare, score, table

from anchorpose.joints import JOINT_COUNT
from anchorpose.track_tree.hypotheses import Feature, HypothesisConfig
from anchorpose.tracker.config import TrackConfig


def test_a_joint_without_a_place_counts_as_wrong():
    error_mm = np.full((2, JOINT_COUNT), 10.0)
    error_mm[0, :3], error_mm[1, 3] = np.nan, 160.0
    found = score("arms-3", 1, GEODESIC, error_mm, 0.5)
    assert found.mean_mm == pytest.approx((38 * 10.0 + 3 * MISSING_MM + 160.0) / 42)
    assert found.wrong_share == pytest.approx(4 / 42)
    assert found.ms == pytest.approx(250.0)


def test_variants_differ_from_the_default_in_one_setting_each():
    default = TrackConfig()
    assert VARIANTS[GEODESIC](default) == default
    always, position, neither = (VARIANTS[variant](default) for variant in (ALWAYS, POSITION, NEITHER))
    assert always == replace(default, hypotheses=HypothesisConfig(always=True))
    assert position.hypotheses == HypothesisConfig(feature=Feature.POSITION, always=True)
    assert (position.registration, neither.hypotheses) == (default.registration, default.hypotheses)
    assert neither.registration.held_steps == 0


def _scores():
    for seed, geodesic_mm, position_mm in ((1, 10.0, 11.0), (2, 20.0, 22.0), (3, 90.0, 93.0)):
        for variant, mm in ((GEODESIC, geodesic_mm), (POSITION, position_mm)):
            yield score("arms-3", seed, variant, np.full((2, JOINT_COUNT), mm), 0.2 if variant == GEODESIC else 0.1)


def test_differences_are_paired_by_recording():
    """Recordings differ by 80 mm, variants by 1, 2 and 3: mean 2, t of 2 degrees of freedom 4.3027."""
    geodesic, position = compare(list(_scores()))
    assert (geodesic.variant, geodesic.less_mm) == (GEODESIC, None)
    assert (position.mean_mm, geodesic.mean_mm) == (pytest.approx(42.0), pytest.approx(40.0))
    assert position.less_mm.mean == pytest.approx(2.0)
    assert position.less_mm.high == pytest.approx(2.0 + 4.3027 / 3**0.5, abs=1e-4)
    assert position.less_ms.mean == pytest.approx(-50.0)


def test_the_order_of_the_scores_does_not_matter_to_a_pair():
    scores = list(_scores())
    assert compare(scores)[1] == compare([*scores[::2], *scores[::-2]])[1]


def test_the_table_names_each_situation_and_the_intervals():
    text = table(compare(list(_scores())), {"arms-3": "fast arms"}, 3)
    assert "| fast arms | position | 42.0 | +2.0 (-0.5 to +4.5) |" in text


@pytest.mark.parametrize("name", SITUATIONS)
def test_every_situation_can_be_simulated_and_has_frames_to_judge(name):
    situation = SITUATIONS[name]
    config = situation.recording(3)
    assert config.seed == 3
    assert situation.from_s < config.seconds - 1.0
