"""People who pass by, and what the truth says of what each camera sees."""

from dataclasses import replace

import numpy as np
import pytest

from anchorpose.joints import JOINT_INDEX
from anchorpose.results.truth import read_truth
from anchorpose.simulate.clinic import draw_clinic
from anchorpose.simulate.config import SimulationConfig
from anchorpose.simulate.render import PATIENT
from anchorpose.simulate.shoot import seen_shares, set_up
from anchorpose.simulate.therapist import PASSING_M, draw_passer_by
from anchorpose.simulate.write import simulate_recording

PASSED = SimulationConfig(seed=8, seconds=6.0, fps=4.0, cameras=1, therapists=1, equipment="none", passers_by=1)


@pytest.mark.thorough
def test_a_person_who_passes_hides_the_patient_for_a_while_and_the_truth_counts_it(tmp_path):
    simulate_recording(tmp_path / "passed", PASSED)
    simulate_recording(tmp_path / "alone", replace(PASSED, passers_by=0))
    passed, alone = (read_truth(tmp_path / name / "truth/truth.npz") for name in ("passed", "alone"))
    assert not alone.occluded.any()
    assert 0 < passed.occluded.sum() < len(passed.occluded) / 2
    assert not passed.occluded[:3].any()
    assert not passed.occluded[-3:].any()
    assert np.array_equal(passed.position_m, alone.position_m)
    shares = passed.seen_share[..., 0].mean(axis=1), alone.seen_share[..., 0].mean(axis=1)
    assert shares[0].min() < 0.5 * shares[1].min()
    assert (shares[0] <= shares[1] + 1e-6).all()
    label = PATIENT + 2  # after the patient and the therapist
    import cv2

    frame = int(np.flatnonzero(passed.occluded)[0])
    labels = cv2.imread(str(tmp_path / f"passed/truth/labels/front/{frame:06d}.png"), cv2.IMREAD_UNCHANGED)
    assert (labels == label).sum() > 2000


def test_a_late_camera_counts_with_the_image_of_the_truths_moment_and_a_missing_image_with_none(tmp_path):
    late = replace(PASSED, seed=2, seconds=3.0, fps=2.0, cameras=2, therapists=0, passers_by=0)
    lossy = replace(late, clock_late_s=(0.0, 1.0), dropped_share=0.3)
    simulate_recording(tmp_path / "even", late)
    simulate_recording(tmp_path / "late", lossy)
    even, shifted = (np.load(tmp_path / name / "truth/truth.npz") for name in ("even", "late"))
    there = np.isin(even["time"], shifted["taken_s"][1])
    assert not there[:2].any(), "the late camera had no image yet"
    assert not there[2:].all(), "an image was lost"
    assert there[2:].any()
    np.testing.assert_array_equal(shifted["seen_share"][..., 0], even["seen_share"][..., 0])
    expected = np.where(there[:, None], even["seen_share"][..., 1], 0.0)
    np.testing.assert_allclose(shifted["seen_share"][..., 1], expected, atol=1e-6)
    np.testing.assert_array_equal(shifted["patient_pixels"] < even["patient_pixels"], ~there)


@pytest.mark.parametrize("seed", range(8))
def test_who_passes_by_comes_from_outside_and_crosses_before_the_camera(seed):
    clinic = draw_clinic(replace(PASSED, seed=seed, cameras=3, therapists=0, passers_by=0))
    passer = draw_passer_by(np.random.default_rng(seed), clinic.config, clinic.cameras, camera=1)
    times_s = np.arange(-8.0, 14.0, 0.1)
    bones = passer.actor.bones(times_s)
    hips_m = bones[:, 0, :3, :3] @ passer.actor.person.body.bone_heads[0] + bones[:, 0, :3, 3]
    camera = clinic.cameras[1]
    away_m = np.linalg.norm((hips_m - camera.position_m)[:, [0, 2]], axis=1)
    assert PASSING_M[0] - 0.2 < away_m.min() < PASSING_M[1] + 0.1
    assert 0.2 * PASSED.seconds < times_s[np.argmin(away_m)] < 0.8 * PASSED.seconds
    assert np.linalg.norm(hips_m[:, [0, 2]], axis=1).min() > 0.6, "nobody walks through the patient"


def test_what_is_behind_the_patients_own_trunk_or_outside_the_image_is_not_seen():
    config = SimulationConfig(seed=1, seconds=1.0, fps=1.0, cameras=2, therapists=0, equipment="none", stool=False)
    studio = set_up(draw_clinic(replace(config, motions=("standing",))))
    shot, camera = studio.shoot(0), studio.clinic.cameras[1]
    left, right = JOINT_INDEX["WristLeft"], JOINT_INDEX["WristRight"]
    assert shot.seen_share[left, 1] > shot.seen_share[right, 1], "the second camera stands on the left"

    person, bones = studio.clinic.patient.person, studio.performances[0].bones[0][0]
    away = -camera.position_m * [1.0, 0.0, 1.0]
    for shift_m in (np.array([0.0, 8.0, 0.0]), 0.15 * away / np.linalg.norm(away)):
        elsewhere = bones.copy()
        elsewhere[:, :3, 3] += shift_m
        shares = seen_shares(person, elsewhere, person.skin(elsewhere, 0.0), camera, shot.images[1])
        assert np.median(shares) < 0.1, "outside the image, or behind the skin that it shows"
