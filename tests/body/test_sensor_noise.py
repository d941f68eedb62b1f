"""What the cameras' noise does to a registered pose: as stated as it is when the same body is seen again and again."""

from collections.abc import Sequence
from dataclasses import replace

import cv2
import numpy as np
import pytest
from body_builder import FRONT, LEFT, NOTHING, adult_body, before_wall, evidence_of, photograph, random_pose, skin_in

from anchorpose.body.belief import PoseBelief
from anchorpose.body.config import RegistrationConfig, UncertaintyConfig
from anchorpose.body.evidence import Evidence, node_noise, rows_alike
from anchorpose.body.pose import DEGREE, POSE_SIZE
from anchorpose.body.registration import register
from anchorpose.body.skin_points import pose_points
from anchorpose.body.uncertainty import finest_patch_m, joint_sigma, noise_covariance
from anchorpose.isolation.depth_noise import DepthNoise
from anchorpose.isolation.view import View

CONFIG, BODY, POSE = RegistrationConfig(), adult_body(), random_pose(3, 0.3)
SIGMA_M = 0.015
TRUE_VIEW = before_wall(photograph(skin_in(POSE, BODY), FRONT), FRONT)


def noise(sigma_m: float = SIGMA_M, shared_px: float = 1.0) -> DepthNoise:
    return DepthNoise((2.0, 3.0), (sigma_m, sigma_m), shared_px=shared_px)


def seen_with(noises: Sequence[DepthNoise | None], views: Sequence[View] = (TRUE_VIEW,)) -> Evidence:
    return replace(evidence_of(views, [FRONT, LEFT][: len(views)]), noises=tuple(noises))


def noisy(seed: int, patch_px: float) -> View:
    white = np.random.default_rng(seed).standard_normal(TRUE_VIEW.depth_m.shape).astype(np.float32)
    patches = cv2.GaussianBlur(white, (0, 0), patch_px) * np.float32(2.0 * np.sqrt(np.pi) * patch_px)
    return View((TRUE_VIEW.depth_m + SIGMA_M * patches).astype(np.float32), TRUE_VIEW.labels)


def predicted() -> PoseBelief:
    variance = np.append(np.full(POSE_SIZE - 3, (4.0 * DEGREE) ** 2), np.full(3, 0.02**2))
    return PoseBelief(POSE, np.diag(variance), np.diag(1.0 / variance))


def joint_sigmas(belief: PoseBelief, covariance: np.ndarray) -> np.ndarray:
    """(21,) by the noise alone."""
    posed, config = pose_points(BODY, belief.pose), UncertaintyConfig()
    nothing = np.zeros_like(covariance)
    known = joint_sigma(BODY, posed, nothing, config)
    return np.sqrt(joint_sigma(BODY, posed, nothing, config, covariance) ** 2 - known**2)


@pytest.mark.parametrize("patch_px", [0.3, 2.2, 4.0])
def test_joints_scatter_over_noisy_frames_as_much_as_is_stated(patch_px):
    """The oracle: frames that differ by noise alone, of which 4 pi patch_px^2 pixels have one error in common."""
    found = [
        register(BODY, predicted(), evidence_of([noisy(k, patch_px)], [FRONT]), NOTHING, CONFIG) for k in range(24)
    ]
    joints = np.array([BODY.mesh.joints(pose_points(BODY, one.belief.pose).transforms) for one in found])
    scatter_m = np.sqrt(joints.var(axis=0, ddof=1).mean(axis=1))
    evidence = seen_with([noise(shared_px=4.0 * np.pi * patch_px**2)], [noisy(0, patch_px)])
    stated_m = joint_sigmas(found[0].belief, noise_covariance(BODY, found[0].belief, evidence, CONFIG))
    assert scatter_m.mean() > 0.0005
    # the robust kernel and the change of corresponding points are not in the linear model
    assert 0.8 < np.sqrt(np.mean(stated_m**2) / np.mean(scatter_m**2)) < 1.5
    assert np.corrcoef(stated_m, scatter_m)[0, 1] > 0.6


def test_twice_the_noise_is_twice_the_sigma_and_wider_patches_average_less():
    belief = register(BODY, predicted(), seen_with([]), NOTHING, CONFIG).belief
    once, louder, wider = (
        joint_sigmas(belief, noise_covariance(BODY, belief, seen_with([law]), CONFIG))
        for law in (noise(0.005, 1.0), noise(0.010, 1.0), noise(0.005, 25.0))
    )
    np.testing.assert_allclose(louder, 2.0 * once, rtol=1e-6)
    assert (wider > 1.5 * once).all()
    assert 2.5 < np.median(wider / once) < 5.0  # fivefold on a flat wall, less where limbs are narrower than patches


def test_a_node_feels_the_noise_along_its_normal_at_its_slant():
    """A facing node has all of it; at a slant the noise is larger, and less of it is along the normal."""
    evidence, slanted = seen_with([noise(0.01)]), DepthNoise((2.0, 3.0), (0.01, 0.01), slants=(2.0, None))
    (plain, _), (more, _) = node_noise(evidence), node_noise(seen_with([slanted]))
    ray = evidence.surface.points_m - FRONT.position_m
    cosine = -(ray * evidence.surface.normals).sum(axis=1) / np.linalg.norm(ray, axis=1)
    beyond = cosine < np.cos(35.0 * DEGREE)
    np.testing.assert_allclose(more / plain, np.where(beyond, 2.0, 1.0), rtol=1e-6)
    along = plain / cosine * cosine.max() / plain[cosine.argmax()]
    assert (np.abs(along - 1.0) < 0.1).mean() > 0.95  # all but nodes at an edge, whose normal is another one


def test_each_camera_has_its_own_noise_and_one_without_a_picture_none():
    views = [before_wall(photograph(skin_in(POSE, BODY), camera), camera) for camera in (FRONT, LEFT)]
    evidence = seen_with([noise(), None], views)
    found, _ = node_noise(evidence)
    assert (found[evidence.surface.camera == 0] > 0).all()
    assert (found[evidence.surface.camera == 1] == 0).all()


def test_the_patch_at_the_patient_is_that_of_the_camera_that_resolves_most():
    views = [before_wall(photograph(skin_in(POSE, BODY), camera), camera) for camera in (FRONT, LEFT)]
    coarse, fine = noise(shared_px=100.0), noise(shared_px=1.0)
    one = finest_patch_m(seen_with([fine, coarse], views))
    assert one == pytest.approx(2.4 / 365.0, rel=0.1)
    assert finest_patch_m(seen_with([coarse, None], views)) == pytest.approx(10.0 * one)
    assert finest_patch_m(seen_with([None, None], views)) == finest_patch_m(seen_with([], views)) == 0.0


def test_rows_count_less_the_more_noise_they_share():
    """Each patch is one observation with the variance of the settings' observation and of the noise."""
    plain, own = rows_alike(seen_with([]), CONFIG), CONFIG.rows_per_observation
    assert plain == own
    independent, patches, louder = (
        rows_alike(seen_with([law]), CONFIG) - own for law in (noise(0.004), noise(0.004, 100.0), noise(0.008, 100.0))
    )
    assert 0.0 < independent < 0.2
    assert louder == pytest.approx(4.0 * patches)
    nodes_per_patch = 100.0 * min(CONFIG.node_count, len(seen_with([]).surface)) / TRUE_VIEW.patient.sum()
    assert patches == pytest.approx(0.4**2 * nodes_per_patch, rel=0.4)  # noise along the normals, and border patches
