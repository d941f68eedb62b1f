"""The learnt descriptor: places on the body of simulated people, and files that are no network."""

import re
from pathlib import Path

import numpy as np
import pytest

from anchorpose.body.asset import stored_asset
from anchorpose.camera import Camera
from anchorpose.descriptor.learnt import (
    FOCAL_PX,
    REMEMBERED,
    STEP,
    WIDEST,
    Described,
    describe,
    described,
    inputs_of,
    nearest_rays,
    read_weights,
    stored_weights,
)
from anchorpose.errors import InputError
from anchorpose.lens import Intrinsics, LensModel, rays_of_pixels
from anchorpose.simulate.clinic import draw_clinic
from anchorpose.simulate.config import single
from anchorpose.simulate.render import PATIENT, TrueImage
from anchorpose.simulate.shoot import set_up


def camera(focal_px: float = 365.0, **lens: object) -> Camera:
    intrinsics = Intrinsics(fx=focal_px, fy=focal_px, cx=256.0, cy=212.0, **lens)  # type: ignore[arg-type]
    return Camera(name="front", width=512, height=424, depth_scale=0.001, intrinsics=intrinsics)


@pytest.fixture(scope="module")
def person() -> tuple[Described, np.ndarray, TrueImage, Camera]:
    """One image of one person, what is said of it, and the truth."""
    studio = set_up(draw_clinic(single(seed=17, seconds=1.0)))
    shot, seen_by = studio.shoot(0), studio.clinic.cameras[0]
    depth_m = shot.depths_mm[0] * np.float32(0.001)
    return describe(depth_m, seen_by), depth_m, shot.images[0], seen_by


def test_a_person_is_found_and_the_room_is_nobody(person: tuple[Described, np.ndarray, TrueImage, Camera]) -> None:
    said, depth_m, true, _ = person
    here = said.row, said.column
    on_it = said.read & (np.abs(depth_m[here] - true.depth_m[here]) < 0.03)
    is_person = true.label[here] >= PATIENT
    assert (said.person >= 0.5)[on_it & is_person].mean() > 0.97
    assert (said.person >= 0.5)[on_it & ~is_person].mean() < 0.01


def test_places_lie_on_the_part_of_the_body_that_was_drawn(
    person: tuple[Described, np.ndarray, TrueImage, Camera],
) -> None:
    said, _, true, _ = person
    asset = stored_asset()
    centre = np.stack(
        [asset.vertices[asset.main_bone() == bone].mean(axis=0) for bone in range(31) if bone in asset.main_bone()]
    )
    bones = np.unique(asset.main_bone())
    drawn = true.part[said.row, said.column].astype(int) - 1
    found = (said.person >= 0.5) & (drawn >= 0)
    stature = float(np.ptp(asset.vertices[:, 1]))
    off_m = np.linalg.norm(said.place[found] * stature - centre[np.searchsorted(bones, drawn[found])], axis=1)
    assert np.median(off_m) < 0.15  # from the middle of a part to its skin
    height = said.place[found][:, 1]
    assert height.min() > -0.05
    assert height.max() < 1.05


def test_votes_meet_at_the_pelvis(person: tuple[Described, np.ndarray, TrueImage, Camera]) -> None:
    said, depth_m, true, seen_by = person
    hips = true.part[said.row, said.column] == 1 + stored_asset().bone("Hips")
    on_hips = hips & said.read & (said.person >= 0.5)
    points = seen_by.back_project(depth_m)[said.row[on_hips], said.column[on_hips]]
    votes = said.pelvis_m[said.person >= 0.5]
    assert np.linalg.norm(np.median(votes, axis=0) - np.median(points, axis=0)) < 0.25


def test_nothing_is_said_where_nothing_was_read(person: tuple[Described, np.ndarray, TrueImage, Camera]) -> None:
    said = person[0]
    assert (said.person[~said.read] == 0.0).all()
    nobody = said.person < 0.5
    for values in (said.place, said.error, said.pelvis_m):
        assert np.isnan(values[nobody]).all()
        assert np.isfinite(values[~nobody]).all()
    assert (said.error[~nobody] > 0.0).all()


def test_the_same_image_is_described_by_the_same_bytes(person: tuple[Described, np.ndarray, TrueImage, Camera]) -> None:
    said, depth_m, _, seen_by = person
    again = describe(depth_m, seen_by, read_weights(weights_file()))
    assert all(
        np.array_equal(one, other, equal_nan=one.dtype.kind == "f") for one, other in zip(said, again, strict=True)
    )


def test_a_lens_that_bends_shows_the_same_people() -> None:
    """The same room through a pinhole and through a fisheye: rays count, not pixels."""
    studio = set_up(draw_clinic(single(seed=17, seconds=1.0)))
    truth = studio.shoot(0).images[0]
    plain = studio.clinic.cameras[0]
    bent_lens = Intrinsics(
        fx=365.0, fy=365.0, cx=256.0, cy=212.0, distortion=(0.0, 0.0, 0.0, 0.0), model=LensModel.KANNALA_BRANDT
    )
    bent = Camera(name="bent", width=512, height=424, depth_scale=0.001, intrinsics=bent_lens)
    rays = bent.pixel_rays().reshape(-1, 2)
    column, row, inside = plain.pixel_of(np.column_stack([rays, np.ones(len(rays))]))
    seen = np.where(inside, truth.depth_m[row, column], 0.0).reshape(424, 512)
    counts = [int((describe(depth, by).person >= 0.5).sum()) for depth, by in ((truth.depth_m, plain), (seen, bent))]
    assert counts[1] == pytest.approx(counts[0], rel=0.03)


LENSES = {
    "pinhole": camera(),
    "barrel": camera(300.0, distortion=(-0.2, 0.05, 0.001, -0.001, 0.0)),
    "wide": camera(150.0, distortion=(0.0, 0.0, 0.0, 0.0), model=LensModel.KANNALA_BRANDT),
}


@pytest.mark.parametrize("seen_by", LENSES.values(), ids=LENSES.keys())
def test_the_ray_of_each_pixel_is_the_nearest_one(seen_by: Camera) -> None:
    row, column, inside = nearest_rays(seen_by)
    of_pixel = rays_of_pixels(seen_by.intrinsics, seen_by.width, seen_by.height)
    down, across = describe(np.zeros((424, 512), np.float32), seen_by).person.shape
    first = np.maximum(np.nanmin(of_pixel.reshape(-1, 2), axis=0), -WIDEST)
    grid = first + np.stack(np.meshgrid(np.arange(across), np.arange(down)), axis=-1) * STEP / FOCAL_PX
    some = tuple(np.random.default_rng(2).integers(0, [[424], [512]], (2, 300)))
    away = np.linalg.norm(grid[None] - of_pixel[some][:, None, None], axis=-1).reshape(300, -1)
    known = inside[some]
    chosen = row[some] * across + column[some]
    np.testing.assert_allclose(away[np.arange(300), chosen][known], np.nanmin(away[known], axis=1), atol=1e-6)
    beyond = np.nanmin(np.where(np.isfinite(away), away, np.inf), axis=1) > STEP / FOCAL_PX
    assert (known == ~beyond).all()
    assert known.mean() > 0.2


def test_an_image_is_described_once_and_no_other_is_taken_for_it(
    person: tuple[Described, np.ndarray, TrueImage, Camera],
) -> None:
    _, depth_m, _, seen_by = person
    known = described(depth_m, seen_by)
    assert described(depth_m, seen_by) is known
    assert described(depth_m.copy(), seen_by) is not known
    assert described(depth_m, camera(400.0)) is not known
    for number in range(2 * REMEMBERED):  # of which none lives on: ids are used again
        other = depth_m * np.float32(1.0 + 0.01 * number)
        np.testing.assert_array_equal(described(other, seen_by).person, describe(other, seen_by).person)
    np.testing.assert_array_equal(described(depth_m, seen_by).person, known.person)


def test_an_empty_image_holds_nobody() -> None:
    said = describe(np.zeros((424, 512), np.float32), camera())
    assert not said.read.any()
    assert not (said.person > 0.0).any()


def test_relief_is_taken_from_readings_alone() -> None:
    depth_m = np.full((64, 64), 2.0, np.float32)
    depth_m[:, 32:] = 0.0
    layers = inputs_of(depth_m)
    assert np.allclose(layers[:, :, :32], np.array([0.5, 1.0, 0.0, 0.0, 0.5])[:, None, None], atol=1e-5)
    assert (layers[:, :, 32:] == 0.0).all()


def test_an_image_of_a_few_degrees_is_refused() -> None:
    with pytest.raises(ValueError, match="at least 9 degrees"):
        describe(np.ones((424, 512), np.float32), camera(focal_px=4000.0))


def test_an_image_of_another_size_is_refused() -> None:
    with pytest.raises(ValueError, match=r"\(400, 512\) pixels, the camera \(424, 512\)"):
        describe(np.ones((400, 512), np.float32), camera())


@pytest.mark.parametrize("value", [np.nan, np.inf, -1.0, 1e6])
def test_what_is_no_depth_is_no_reading(value: float) -> None:
    said = describe(np.full((424, 512), value, np.float32), camera())
    assert not said.read.any()


def weights_file() -> Path:
    import anchorpose.descriptor as package

    return Path(package.__path__[0]) / "data" / "learnt.weights"


def test_the_weights_say_where_they_are_from_and_are_small() -> None:
    about = stored_weights().about
    assert about["images"] > 1_000_000
    assert re.fullmatch("[0-9a-f]{64}", about["script_sha256"])
    assert weights_file().stat().st_size < 5_000_000


@pytest.mark.parametrize("spoil", ["absent", "empty", "text", "cut", "bit", "network"])
def test_a_file_that_is_no_network_is_one_sentence_with_its_name(tmp_path: Path, spoil: str) -> None:
    path = tmp_path / "other.weights"
    whole = weights_file().read_bytes()
    if spoil != "absent":
        bit = whole[:-1000] + bytes([whole[-1000] ^ 1]) + whole[-999:]
        network = whole.partition(b"\n")[2]
        content = {"empty": b"", "text": b"no network", "cut": whole[:1_000_000], "bit": bit, "network": network}
        path.write_bytes(content[spoil])
    with pytest.raises(InputError, match=r"other\.weights: .*; .*\.$"):
        read_weights(path)


def test_a_camera_that_shows_too_little_is_refused_by_name():
    narrow = camera(5000.0)
    with pytest.raises(InputError, match=r"camera front: .* at least 9 degrees.*; correct the intrinsics"):
        described(np.ones((narrow.height, narrow.width), np.float32), narrow)
