"""People in simulated images, each found once by the votes of the pixels."""

import numpy as np
import pytest

from anchorpose.descriptor.learnt import Described, describe
from anchorpose.descriptor.people import find_people, people_mask
from anchorpose.simulate.clinic import draw_clinic
from anchorpose.simulate.config import clinic, single
from anchorpose.simulate.render import PATIENT
from anchorpose.simulate.shoot import Shot, Studio, set_up

SURE = 0.85


def test_one_person_in_an_empty_room_is_one() -> None:
    studio = set_up(draw_clinic(single(seed=23, seconds=1.0)))
    found, labels = found_in(studio, studio.shoot(0), camera=0)
    assert len(found) == 1
    assert found[0].certainty > SURE
    assert (labels[found[0].rays[0]] == PATIENT).mean() > 0.95  # pixels at edges may look a pixel aside


def test_a_patient_and_those_who_hold_are_told_apart() -> None:
    config = clinic(seed=31, seconds=2.0)
    studio = set_up(draw_clinic(config))
    shot = studio.shoot(config.frames // 2)
    for camera in range(3):
        found, labels = found_in(studio, shot, camera)
        shown = {label: int((labels == label).sum()) for label in np.unique(labels) if label >= PATIENT}
        plain = [label for label, pixels in shown.items() if pixels > 400]
        owners = [int(np.bincount(labels[person.rays[0]]).argmax()) for person in found if person.certainty > SURE]
        assert sorted(owner for owner in owners if owner in plain) == sorted(plain)


def test_nobody_is_found_where_nothing_is_a_person() -> None:
    nothing = np.zeros((4, 4))
    unknown = np.full((4, 4, 3), np.nan)
    index = nothing.astype(np.int64)
    said = Described(index, index, nothing > 0, nothing, unknown, unknown[..., 0], unknown)
    assert find_people([said, None], [np.ones((4, 4)), None], [np.eye(4)] * 2) == ()


def test_votes_for_two_places_are_two_people_and_a_few_pixels_nobody() -> None:
    row, column = np.indices((40, 40))
    person, votes = np.ones((40, 40)), np.zeros((40, 40, 3))
    votes[:, 20:, 0] = 0.5  # side by side
    votes[:2, :2] = [0.0, 0.0, 3.0]
    said = Described(row, column, person > 0, person, votes, person, votes)
    found = find_people([said], [np.full((40, 40), 2.0)], [np.eye(4)])
    assert [person.pelvis_m.tolist() for person in found] == [[0.5, 0.0, 0.0], [0.0, 0.0, 0.0]]
    assert found[0].rays[0][:, 20:].all()
    assert not found[0].rays[0][:, :20].any()
    assert found[1].area_m2 == pytest.approx(796 * 0.02**2)


@pytest.mark.parametrize("apart_m", [0.0, 1.0], ids=["one place", "two places"])
def test_votes_of_two_cameras_meet_in_the_common_frame(apart_m: float) -> None:
    row, column = np.indices((20, 20))
    person, votes, depth_m = np.ones((20, 20)), np.full((20, 20, 3), [0.0, 0.0, 2.0]), np.full((20, 20), 2.0)
    said, beside = Described(row, column, person > 0, person, votes, person, votes), np.eye(4)
    beside[0, 3] = 3.0
    other = said._replace(pelvis_m=votes - [3.0 - apart_m, 0.0, 0.0])
    found = find_people([said, other], [depth_m, depth_m], [np.eye(4), beside])
    assert len(found) == (1 if apart_m == 0.0 else 2)
    assert sum(one.rays[1].sum() for one in found) == 400
    assert found[0].area_m2 == pytest.approx((800 if apart_m == 0.0 else 400) * 0.02**2)


@pytest.mark.parametrize("seed", [23, 24, 25])
def test_the_mask_covers_a_person_and_little_else(seed: int) -> None:
    studio = set_up(draw_clinic(single(seed=seed, seconds=1.0)))
    shot, camera = studio.shoot(0), studio.clinic.cameras[0]
    depth_m, true = shot.depths_mm[0] * np.float32(0.001), shot.images[0].label >= PATIENT
    mask, read = people_mask(depth_m, camera), depth_m > 0
    assert mask[true & read].mean() > 0.97
    above_feet = np.arange(len(true))[:, None] < np.quantile(np.nonzero(true)[0], 0.9)
    assert (mask & ~true & above_feet).sum() < 0.03 * true.sum()
    assert (mask & ~true).sum() < 0.2 * true.sum()  # the floor around the feet is as near as they are


def found_in(studio: Studio, shot: Shot, camera: int) -> tuple[tuple, np.ndarray]:
    """The people that are found in one image, and the true label of each ray."""
    depth_m = shot.depths_mm[camera] * np.float32(0.001)
    said = describe(depth_m, studio.clinic.cameras[camera])
    return find_people([said], [depth_m], [np.eye(4)]), shot.images[camera].label[said.row, said.column].astype(int)
