"""HKS, scale-invariant HKS and WKS: plain loops and pyFM as oracles, known answers, laws, what is not defined."""

from dataclasses import replace

import numpy as np
import pytest
from spectral_builder import ball, flag, scaled, shuffled
from surface_builder import flat_grid, moved

from anchorpose.research.features.laplacian import mesh_laplacian
from anchorpose.research.features.spectral_signatures import (
    HksConfig,
    SiHksConfig,
    Spectrum,
    WksConfig,
    heat_times,
    hks,
    si_hks,
    spectrum,
    spectrum_of,
    wave_energies,
    wks,
)
from anchorpose.surface.mesh import keep_nodes

pytestmark = pytest.mark.thorough

SIGNATURES = (hks, si_hks, wks)
PAIRS = 60


@pytest.fixture(scope="module")
def sheet() -> Spectrum:
    return spectrum(flag(), PAIRS)


def plain_hks(found: Spectrum, node: int, time: float) -> float:
    heat = 0.0
    for value, wave in zip(found.eigenvalues, found.eigenfunctions[node], strict=True):
        heat += np.exp(-value * time) * wave**2
    return heat


@pytest.mark.parametrize("scale", [False, True])
def test_hks_is_the_sum_that_sun_et_al_write_down(sheet, scale):
    low, high = sheet.eigenvalues[1], sheet.eigenvalues[-1]
    times = np.exp(np.linspace(np.log(4 * np.log(10) / high), np.log(4 * np.log(10) / low), 100))
    for node in (0, 17, 400):
        known = np.array([plain_hks(sheet, node, time) for time in times])
        if scale:
            known /= [sum(np.exp(-value * time) for value in sheet.eigenvalues) for time in times]
        found = hks(sheet, HksConfig(scaled=scale))
        np.testing.assert_allclose(found[node], known, rtol=1e-5)


def test_wks_is_the_sum_that_aubry_et_al_write_down(sheet):
    level = [np.log(value) for value in sheet.eigenvalues[1:]]
    sigma = 7 * (level[-1] - level[0]) / 100
    for node in (0, 17, 400):
        known = []
        for e in np.linspace(level[0] + 2 * sigma, level[-1] - 2 * sigma, 100):
            bells = [np.exp(-((e - one) ** 2) / (2 * sigma**2)) for one in level]
            squares = [wave**2 for wave in sheet.eigenfunctions[node, 1:]]
            known.append(sum(bell * square for bell, square in zip(bells, squares, strict=True)) / sum(bells))
        np.testing.assert_allclose(wks(sheet)[node], known, rtol=1e-5)


def test_scale_invariant_hks_is_the_spectrum_of_the_logarithm_s_differences(sheet):
    step = 1 / 16
    octave = -22 + np.arange(0, 24, step)
    for node in (0, 17, 400):
        ends = [np.log([plain_hks(sheet, node, 2.0**tau) for tau in octave + half]) for half in (-step / 2, step / 2)]
        known = np.abs(np.fft.fft(ends[1] - ends[0]))[:6]
        np.testing.assert_allclose(si_hks(sheet)[node], known, rtol=1e-4, atol=1e-4)


def test_pyfm_finds_the_same(sheet):
    theirs = pytest.importorskip("pyFM.signatures", reason="pyFM (pyfmaps 1.3.1 was compared) is not installed")
    times, (energies, width) = heat_times(sheet, HksConfig()), wave_energies(sheet, WksConfig())
    values, waves = sheet.eigenvalues, sheet.eigenfunctions
    for scale in (False, True):
        known = theirs.HKS(values, waves, times, scaled=scale)
        np.testing.assert_allclose(hks(sheet, HksConfig(scaled=scale)), known, rtol=1e-4)
    np.testing.assert_allclose(wks(sheet), theirs.WKS(values, waves, energies, width, scaled=True), rtol=1e-4)


def test_on_a_sphere_every_node_is_alike():
    points, triangles = ball()
    found = spectrum_of(mesh_laplacian(points, triangles), len(points), 121)  # to degree 10
    area = 4 * np.pi * 0.3**2
    heat = hks(found, HksConfig(range_m2=(0.005, 1.0), scaled=False))
    np.testing.assert_allclose(heat, np.tile(heat.mean(axis=0), (len(heat), 1)), rtol=0.03)
    degree = np.arange(11)
    time = 0.005
    known = ((2 * degree + 1) * np.exp(-degree * (degree + 1) / 0.09 * time)).sum() / area
    assert heat[:, 0].mean() == pytest.approx(known, rel=0.03)
    assert heat[:, -1].mean() == pytest.approx(1 / area, rel=0.01)


def test_soon_a_plane_s_middle_has_lost_what_a_plane_loses_its_rim_half_of_it_its_corner_a_quarter():
    surface = flat_grid(25, 25, 0.01)  # from the middle, the mirrored heat of a rim is 6e-6 of the middle's own
    time = 0.0012
    found = spectrum(surface, 200)
    assert np.exp(-found.eigenvalues[-1] * time) < 1e-6  # waves that are left out have no heat any more
    node = [np.flatnonzero((surface.pixel == pixel).all(axis=1))[0] for pixel in ([12, 12], [12, 0], [0, 0])]
    heat = hks(found, HksConfig(times=2, range_m2=(time, 1.0), scaled=False))[node, 0]
    np.testing.assert_allclose(heat * 4 * np.pi * time, [1.0, 2.0, 4.0], rtol=0.03)


@pytest.mark.parametrize("signature", SIGNATURES)
def test_motion_numbering_and_bending_change_nothing(signature, sheet):
    known = signature(sheet)
    spread = known.std(axis=0)
    order = np.random.default_rng(3).permutation(len(known))
    shuffled_rows = signature(spectrum(shuffled(flag(), order), PAIRS))
    assert np.abs(shuffled_rows - known[order]).max() < 1e-4 * spread.max()
    for other in (moved(flag()), flag(turn_rad=0.15)):  # the second is rolled up almost all the way round
        assert (np.abs(signature(spectrum(other, PAIRS)) - known) < 0.02 * spread.max()).all()


@pytest.mark.parametrize("signature", SIGNATURES)
def test_a_mirror_image_is_described_alike(signature):
    surface = flat_grid(15, 20, 0.02)
    rows = signature(spectrum(surface, 43))
    mirror = np.lexsort([-surface.pixel[:, 1], surface.pixel[:, 0]])
    np.testing.assert_allclose(rows[mirror], rows, rtol=0.02)  # but for the diagonals of the cells
    assert np.ptp(rows, axis=0).max() > 0.5 * np.abs(rows).max(axis=0).min()


@pytest.mark.parametrize("size", [0.5, 0.8, 1.7])
def test_only_the_scale_invariant_signature_does_not_see_size(size, sheet):
    larger = spectrum(scaled(flag(), size), PAIRS)
    known = si_hks(sheet)
    np.testing.assert_allclose(si_hks(larger), known, rtol=2e-3, atol=2e-3)
    assert known.std(axis=0).min() > 0.05
    fixed = HksConfig(range_m2=(1e-3, 1.0))
    assert np.median(np.abs(np.log(hks(larger, fixed) / hks(sheet, fixed)))) > 0.1


def test_a_crumb_beside_the_body_changes_nothing_on_the_body():
    surface = flat_grid(20, 31, 0.02)
    body = surface.pixel[:, 1] < 27
    crumb = (surface.pixel[:, 1] > 28) & (surface.pixel[:, 0] < 2)
    alone, beside = spectrum(keep_nodes(surface, body), PAIRS), spectrum(keep_nodes(surface, body | crumb), PAIRS)
    on_body = np.flatnonzero(body[body | crumb])
    for signature, config in (
        (hks, HksConfig(range_m2=(0.01, 1.0))),
        (si_hks, SiHksConfig(first_octave=-7, octaves=10)),
        (wks, WksConfig(range_per_m2=(10.0, 1000.0))),
    ):
        rows, known = signature(beside, config), signature(alone, config)
        np.testing.assert_allclose(rows[on_body], known, rtol=2e-3, atol=1e-4)
    off = np.flatnonzero(~body[body | crumb])
    assert np.isnan(wks(beside)[off]).all()  # no wave is short enough for it
    np.testing.assert_allclose(hks(beside, HksConfig(scaled=False))[off], 1 / 0.0004, rtol=1e-4)  # its heat stays there


@pytest.mark.parametrize("signature", SIGNATURES)
def test_what_has_no_triangle_is_not_known(signature):
    surface = flat_grid(10, 10, 0.02)
    points = surface.points_m.copy()
    points[7] = np.nan
    rows = signature(spectrum(replace(surface, points_m=points), PAIRS))
    np.testing.assert_array_equal(np.flatnonzero(np.isnan(rows).any(axis=1)), [7])
    assert np.isnan(rows[7]).all()
    empty = spectrum(keep_nodes(surface, np.zeros(len(surface), bool)))
    assert signature(empty).shape == (0, rows.shape[1])


def test_a_spectrum_of_constants_alone_gives_neither_times_nor_energies():
    found = spectrum(flat_grid(4, 4, 0.02), 1)
    assert np.isnan(hks(found)).all()
    assert np.isnan(wks(found)).all()
    assert np.isnan(wks(found, WksConfig(range_per_m2=(1.0, 100.0)))).all()
