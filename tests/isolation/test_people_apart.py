"""The person label of every pixel: decisions against brute force, growth up to creases, people who touch and cross."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from room_builder import FRONT, ROOM, body, built_scene, in_front, picture, pillar

from anchorpose.isolation.bystander_memory import (
    BACKWARD_LABELS,
    FORWARD_LABELS,
    MEMORY_S,
    BystanderMemory,
    empty_memory,
    update_memory,
)
from anchorpose.isolation.ownership import CELL_M, SAMPLING_M, OwnershipLikelihood, decide_ownership, sort_likelihood
from anchorpose.isolation.people import PatientChoice, see_people
from anchorpose.isolation.region_growing import grow_regions, smooth_contact_m
from anchorpose.isolation.scene import find_pieces
from anchorpose.isolation.separation import separate, separate_initial
from anchorpose.isolation.view import PixelLabel, View
from anchorpose.recording.equipment import Box

SCENE = built_scene()
CAMERAS = (FRONT,)
A_FRAME_S = 1.0 / 15.0
PATIENT, OTHER = PixelLabel.PATIENT, PixelLabel.OTHER_PERSON


def pieces_of(*parts, seed: int = 3):
    return [find_pieces(picture(FRONT, *ROOM, *parts, seed=seed), SCENE)]


def first_views(pieces):
    return separate_initial(
        pieces, see_people(pieces, CAMERAS * len(pieces)), PatientChoice(np.zeros(2), "", sure=True)
    )


def skin_likelihood(*parts, sigma_m: float = 0.02) -> OwnershipLikelihood:
    """The likelihood of a predicted skin of these parts."""
    points = pieces_of(*parts)[0].points_m[::3]
    return OwnershipLikelihood(
        points, np.full(len(points), PATIENT, np.uint8), np.full(len(points), sigma_m, np.float32)
    )


def follow(*scenes, expected=None):
    """The last view of scenes (tuples of parts) seen one after another, and the memory after it."""
    pieces = pieces_of(*scenes[0])
    views = first_views(pieces)
    memory = update_memory(empty_memory(), pieces, views, [FRONT], 0.0)
    for number, parts in enumerate(scenes[1:]):
        pieces = pieces_of(*parts, seed=10 + number)
        views = separate(pieces, memory, expected, A_FRAME_S, CAMERAS)
        memory = update_memory(memory, pieces, views, [FRONT], A_FRAME_S)
    return views[0], memory


def bar(x: float, y: float, z: float, length_m: float) -> Box:
    """An arm, stretched out sideways."""
    return Box("arm", np.array([x, y, z]), np.array([0.08, 0.08, length_m]), np.eye(3))


def shown(part, *others) -> np.ndarray:
    """(height, width) bool: pixels on which this part is what the camera sees."""
    return picture(FRONT, *ROOM, part, *others) < picture(FRONT, *ROOM, *others) - 1e-3


def test_the_most_likely_owner_is_that_of_a_brute_force_search():
    rng = np.random.default_rng(5)
    likelihood = OwnershipLikelihood(
        rng.uniform(0, 0.15, (400, 3)).astype(np.float32),
        rng.integers(4, 7, 400).astype(np.uint8),
        rng.uniform(0.005, 0.015, 400).astype(np.float32),
    )
    places = rng.uniform(0.02, 0.13, (500, 3)).astype(np.float32)
    gate, lead = 1.5, 0.5
    assert gate * likelihood.sigma_m.max() + SAMPLING_M < CELL_M  # so the cells around a place hold all that count
    won = decide_ownership(sort_likelihood(likelihood), places, np.ones(500, bool), gate, lead)
    distance = np.maximum(np.linalg.norm(places[:, None] - likelihood.points_m, axis=2) - SAMPLING_M, 0.0)
    cost = (distance / likelihood.sigma_m) ** 2 + 2 * np.log(likelihood.sigma_m)
    cost[distance > gate * likelihood.sigma_m] = np.inf
    best = np.stack([np.where(likelihood.owner == k, cost, np.inf).min(axis=1) for k in (4, 5, 6)], axis=1)
    first, second = np.sort(best, axis=1)[:, :2].T
    owned, disputed = np.isfinite(first), np.isfinite(second)
    ahead = np.where(disputed, second - np.where(owned, first, 0.0), np.inf)
    sure, unsure = owned & (ahead > lead + 1e-3), disputed & (ahead < lead - 1e-3)
    assert sure.sum() > 100
    assert unsure.sum() > 50
    assert (won[sure] == 4 + best[sure].argmin(axis=1)).all()
    assert (won[unsure] == 0).all()


def test_places_far_from_all_skin_have_no_owner():
    grid = sort_likelihood(
        OwnershipLikelihood(np.zeros((1, 3), np.float32), np.array([4], np.uint8), np.array([0.02], np.float32))
    )
    places = np.array([[0.01, 0, 0], [0.5, 0, 0], [-0.5, -9, 0]], np.float32)
    assert decide_ownership(grid, places, np.ones(3, bool)).tolist() == [4, 0, 0]


def test_growth_stops_at_the_valley_between_two_who_touch():
    """Two pillars side by side make a valley; seeded far from it on both, each ends there."""
    (pieces,) = pieces_of(pillar(0.0, -0.155), pillar(0.0, 0.155))
    z = pieces.points_m[:, 2]
    seeds = np.where(z < -0.25, 4, np.where(z > 0.06, 5, 0)).astype(np.uint8)  # the right one's much nearer to it
    grown = grow_regions(pieces, seeds)
    trunk = pieces.points_m[:, 1] < 1.35
    assert np.mean(grown[trunk & (z < -0.02)] == 4) > 0.95
    assert np.mean(grown[trunk & (z > 0.02)] == 5) > 0.95
    plain = grow_regions(pieces, seeds, 0.0)
    assert np.mean(plain[trunk & (z < -0.02)] == 4) < 0.93  # without creases they meet halfway between the seeds


def test_growth_does_not_leap_over_a_depth_jump():
    (pieces,) = pieces_of(*body(0.0, 0.0), *body(1.0, 0.25))
    owner = np.where(pieces.points_m[:, 0] > 0.6, OTHER, 0).astype(np.uint8)
    assert (grow_regions(pieces, owner)[pieces.points_m[:, 0] < 0.4] == 0).all()


@pytest.mark.parametrize("predicted", [True, False])
def test_a_helper_who_touches_the_patient_stays_apart(predicted):
    patient, helper = body(0, 0), body(0.05, 0.7)
    arms = [
        Box("arm", np.array([0.05, 1.1, 0.55 - k * 0.05]), np.array([0.08, 0.08, 0.3]), np.eye(3)) for k in range(4)
    ]
    expected = skin_likelihood(*patient) if predicted else None
    view, _ = follow((*patient, *helper), *[(*patient, *helper, arm) for arm in arms], expected=expected)
    assert view.patient[in_front(FRONT, *patient) & ~in_front(FRONT, *helper, arms[-1])].mean() > 0.95
    assert (view.labels == OTHER)[in_front(FRONT, *helper) & ~in_front(FRONT, *patient)].mean() > 0.95
    assert view.patient[shown(arms[-1], *patient, *helper)].mean() < 0.3


def test_a_helpers_hand_on_the_skin_stays_the_helpers_while_it_was_seen_to_come():
    patient, helper = body(0, 0), body(0.1, 0.72)
    arms = [bar(0.19, 1.0, (0.65 + end) / 2, 0.65 - end) for end in np.arange(0.52, 0.1, -0.07)]
    view, _ = follow(
        (*patient, *helper), *[(*patient, *helper, arm) for arm in arms], expected=skin_likelihood(*patient)
    )
    assert view.patient[shown(arms[-1], *patient, *helper)].mean() < 0.25


def test_an_arm_that_outran_its_prediction_is_kept_while_nobody_is_near():
    arm = bar(0.1, 1.2, 0.35, 0.5)
    (view,) = separate(pieces_of(*body(0, 0), arm), empty_memory(), skin_likelihood(*body(0, 0)), A_FRAME_S, CAMERAS)
    assert view.patient[shown(arm, *body(0, 0))].mean() > 0.9


@pytest.mark.thorough
def test_labels_stay_while_one_crosses_in_front_of_another():
    """The helper walks from right to left between the camera and the patient."""
    walk = np.linspace(0.8, -0.8, 33)  # 5 cm a frame
    view, _ = follow(*[(*body(0, 0), *body(0.6, z)) for z in walk])
    patient = in_front(FRONT, *body(0, 0)) & ~in_front(FRONT, *body(0.6, walk[-1]))
    assert view.patient[patient].mean() > 0.97
    assert (view.labels == OTHER)[in_front(FRONT, *body(0.6, walk[-1]))].mean() > 0.97


def test_a_person_who_comes_later_gets_a_label_of_their_own():
    here = (*body(0, 0), *body(0.1, 0.7))
    view, memory = follow(here, here, (*here, *body(0.2, -0.9)))
    newcomer = in_front(FRONT, *body(0.2, -0.9))
    assert (view.labels[newcomer] == OTHER + 1).mean() > 0.95
    assert memory.next_label == OTHER + 2


def test_new_people_get_different_labels_in_the_forward_and_the_backward_pass():
    here = (*body(0, 0), *body(0.1, 0.7))
    _, memory = follow(here)
    newcomer = in_front(FRONT, *body(0.2, -0.9))
    pieces = pieces_of(*here, *body(0.2, -0.9))
    forth, back = (separate(pieces, memory, None, way * A_FRAME_S, CAMERAS)[0].labels[newcomer] for way in (1, -1))
    assert not set(forth[forth >= OTHER].tolist()) & set(back[back >= OTHER].tolist())
    assert (back > OTHER + 1).mean() > 0.95


def remembering(owners: list[int], next_label: int) -> BystanderMemory:
    """A memory of one point on each of some people."""
    count = len(owners)
    return BystanderMemory(np.zeros((count, 3)), np.array(owners, np.uint8), np.zeros(count, np.float32), next_label)


def three_people(labels: list[int]):
    """Pieces and views of a camera that sees one pixel of each of three people, as far as the memory asks for them."""
    depth_m, at = np.zeros((FRONT.height, FRONT.width), np.float32), np.array([0, 3, 6])
    index, label = np.full(depth_m.shape, -1), np.zeros(depth_m.shape, np.uint8)
    index[0, at], label[0, at] = np.arange(3), labels
    points_m = np.eye(3, dtype=np.float32)
    return [SimpleNamespace(index=index, row=0 * at, column=at, points_m=points_m, depth_m=depth_m)], [
        View(depth_m, label)
    ]


@pytest.mark.parametrize(("labels", "way"), [(FORWARD_LABELS, 1), (BACKWARD_LABELS, -1)])
def test_an_hour_of_people_who_come_and_go_has_labels_for_all_of_them(labels, way):
    """A helper with the first label stays all the time, so nobody else gets this label."""
    memory, given = remembering([PATIENT, labels[0]], labels[1]), []
    for _ in range(600):
        given.append(int(memory.free_labels(way * A_FRAME_S)[0]))
        memory = update_memory(memory, *three_people([PATIENT, labels[0], given[-1]]), [FRONT], way * A_FRAME_S)
    assert set(given) == set(labels[1:])
    assert all(one not in given[k + 1 : k + len(labels) - 1] for k, one in enumerate(given))


def test_hidden_skin_is_remembered_and_forgotten_in_time():
    patient, helper = body(0, 0), body(0.0, 0.8)
    screen = Box("screen", np.array([0.9, 1.0, 0.5]), np.array([0.05, 2.0, 0.7]), np.eye(3))
    seen = (*patient, *helper)
    _, memory = follow(seen, (*seen, screen))
    old = memory.age_s > 0
    assert (memory.owner[old] == OTHER).any()  # behind the screen
    _, gone = follow(seen, patient)
    assert not (gone.owner == OTHER).any()  # the room was seen where the helper had stood
    hidden = pieces_of(*seen, screen, seed=40)
    views = separate(hidden, memory, None, MEMORY_S, CAMERAS)
    forgotten = update_memory(memory, hidden, views, [FRONT], MEMORY_S)
    assert (forgotten.age_s == 0).all()


def test_a_helper_whom_a_passer_by_hides_for_two_seconds_keeps_their_label():
    seen = (*body(0, 0), *body(0.0, 0.8))
    screen = Box("screen", np.array([0.9, 1.0, 0.5]), np.array([0.05, 2.0, 0.7]), np.eye(3))
    _, memory = follow(seen, seen)
    for number in range(4):
        hidden = pieces_of(*seen, screen, seed=50 + number)
        memory = update_memory(memory, hidden, separate(hidden, memory, None, 0.5, CAMERAS), [FRONT], 0.5)
    (view,) = separate(pieces_of(*seen, seed=60), memory, skin_likelihood(*body(0, 0)), A_FRAME_S, CAMERAS)
    assert (view.labels[shown_at(pieces_of(*seen, seed=60)[0], 0.8)] == OTHER).mean() > 0.95


def test_an_arm_labelled_as_another_persons_is_the_patients_again_by_the_predicted_skin():
    (pieces,) = pieces_of(*body(0, 0))
    (view,) = first_views([pieces])
    labels = view.labels.copy()
    arm = view.patient & (np.arange(FRONT.width)[None] < np.argwhere(view.patient)[:, 1].mean() - 8)
    labels[arm] = OTHER
    memory = update_memory(empty_memory(), [pieces], [replace(view, labels=labels)], [FRONT], 0.0)
    assert (labels == OTHER).sum() > 100
    assert (memory.owner == OTHER).any()
    later = pieces_of(*body(0, 0), seed=61)
    (view,) = separate(later, memory, skin_likelihood(*body(0, 0)), A_FRAME_S, CAMERAS)
    assert (view.labels[arm] == PATIENT).mean() > 0.9


def test_a_strip_of_a_person_behind_the_patient_is_remembered_as_theirs():
    """A helper behind the patient, of whom little is seen, must not become a limb of the patient."""
    strip = Box("helper", np.array([-0.05, 1.1, 0.33]), np.array([0.1, 0.4, 0.12]), np.eye(3))
    (pieces,), seen = pieces_of(*body(0, 0), strip), shown(strip, *body(0, 0))
    (view,) = first_views([pieces])
    labels = np.where(seen & (view.labels >= PATIENT), np.uint8(OTHER), view.labels)
    memory = update_memory(empty_memory(), [pieces], [replace(view, labels=labels)], [FRONT], 0.0)
    later = pieces_of(*body(0, 0), strip, seed=61)
    (view,) = separate(later, memory, skin_likelihood(*body(0, 0)), A_FRAME_S, CAMERAS)
    assert (view.labels[seen] == OTHER).mean() > 0.9


def test_a_missing_picture_stays_missing():
    pieces = [*pieces_of(*body(0, 0)), None]
    views = first_views(pieces)
    assert views[1] is None
    memory = update_memory(empty_memory(), pieces, views, [FRONT, FRONT], 0.0)
    assert separate(pieces, memory, None, A_FRAME_S, CAMERAS * 2)[1] is None


def test_a_moment_without_any_depth_image_has_no_view_even_where_the_patient_is_expected():
    assert separate([None], empty_memory(), skin_likelihood(*body(0, 0)), A_FRAME_S, CAMERAS) == (None,)


def test_a_forearm_that_a_bar_cuts_off_is_its_owners():
    """No skin was expected there: it came from behind somebody. It nearly touches the patient and nobody else."""
    stump, forearm = bar(0.1, 1.2, 0.22, 0.2), bar(0.1, 1.2, 0.55, 0.3)
    (view,) = separate(
        pieces_of(*body(0, 0), stump, forearm), empty_memory(), skin_likelihood(*body(0, 0)), A_FRAME_S, CAMERAS
    )
    assert view.patient[shown(forearm, *body(0, 0), stump)].mean() > 0.9
    far = bar(0.1, 1.2, 0.9, 0.3)
    (view,) = separate(
        pieces_of(*body(0, 0), stump, far), empty_memory(), skin_likelihood(*body(0, 0)), A_FRAME_S, CAMERAS
    )
    assert not view.patient[shown(far, *body(0, 0), stump)].any()


def contact_m(pieces, of) -> float:
    return float(smooth_contact_m(pieces, of, 2)[0, 1])


def test_one_body_that_was_divided_goes_on_where_two_who_touch_meet_in_a_crease():
    (one,) = pieces_of(pillar(0.0, 0.0))
    divided = contact_m(one, (one.points_m[:, 2] > 0.0).astype(int))
    assert 1.2 < divided < 1.8  # from top to bottom
    (two,) = pieces_of(pillar(0.0, -0.16), pillar(0.0, 0.16))
    touching = contact_m(two, (two.points_m[:, 2] > 0.0).astype(int))
    assert touching < 0.3 * divided
    assert contact_m(one, np.zeros(len(one.row), int)) == 0.0
    assert contact_m(one, np.full(len(one.row), -1)) == 0.0


def test_half_of_the_patient_remembered_as_another_person_is_given_back():
    """The half has no body, lies on the patient's expected skin, and the surface goes on from one half to the other."""
    pieces = pieces_of(*body(0.0, 0.0))
    mistaken = np.where(pieces[0].points_m[:, 2] > 0.0, OTHER, PATIENT).astype(np.uint8)
    labels = pieces[0].labels.copy()
    labels[pieces[0].row, pieces[0].column] = mistaken
    memory = update_memory(empty_memory(), pieces, (View(pieces[0].depth_m, labels),), [FRONT], 0.0)
    assert OTHER in memory.owner
    expected = skin_likelihood(*body(0.0, 0.0))
    (view,) = separate(pieces, memory, expected, A_FRAME_S, CAMERAS)
    assert (view.labels != OTHER).all()
    assert view.patient.sum() > 0.95 * len(pieces[0].row)
    (without,) = separate(pieces, memory, None, A_FRAME_S, CAMERAS)  # nobody's skin is expected: memory alone
    assert (without.labels == OTHER).any()


def test_somebody_beside_the_patient_is_no_part_of_them():
    pieces = pieces_of(*body(0.0, 0.0), *body(0.0, 0.6))
    views = first_views(pieces)
    memory = update_memory(empty_memory(), pieces, views, [FRONT], 0.0)
    (view,) = separate(pieces, memory, skin_likelihood(*body(0.0, 0.0)), A_FRAME_S, CAMERAS)
    assert (view.labels[shown_at(pieces[0], 0.6)] >= OTHER).mean() > 0.95


def shown_at(pieces, z: float) -> tuple[np.ndarray, np.ndarray]:
    """Rows and columns of the pixels about an axis at x = 0."""
    near = np.hypot(pieces.points_m[:, 0], pieces.points_m[:, 2] - z) < 0.2
    return pieces.row[near], pieces.column[near]


def test_a_patient_who_is_expected_elsewhere_does_not_become_a_new_person():
    pieces = pieces_of(*body(0.0, 0.0))
    memory = update_memory(empty_memory(), pieces, first_views(pieces), [FRONT], 0.0)
    (view,) = separate(pieces, memory, skin_likelihood(*body(0.0, 1.2)), A_FRAME_S, CAMERAS)
    assert (view.labels < OTHER).all()
    assert view.patient.sum() > 0.95 * len(pieces[0].row)


def test_a_piece_that_had_the_patients_label_by_mistake_does_not_keep_it():
    """It lies on no expected skin and touches nobody: only the mistake of the frame before speaks for it."""
    thing = pillar(-0.6, 0.9)
    pieces = pieces_of(*body(0.0, 0.0), thing)
    labels = pieces[0].labels.copy()
    labels[pieces[0].row, pieces[0].column] = PATIENT
    mistaken = (View(pieces[0].depth_m, labels),)
    memory = update_memory(empty_memory(), pieces, mistaken, [FRONT], 0.0)
    (view,) = separate(pieces, memory, skin_likelihood(*body(0.0, 0.0)), A_FRAME_S, CAMERAS)
    assert not view.patient[shown(thing, *body(0.0, 0.0))].any()
    assert view.patient[in_front(FRONT, *body(0.0, 0.0))].mean() > 0.95
