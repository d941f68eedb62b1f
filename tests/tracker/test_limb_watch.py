"""The watch over limbs: what puts a frame in doubt, and how long a search that found nothing is not repeated."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from body_builder import adult_body, standing

from anchorpose.body.belief import vague_belief
from anchorpose.body.config import RegistrationConfig, Source
from anchorpose.body.constraints import anchor_points
from anchorpose.body.limb_search import LOOK_AGAIN_M2, Search
from anchorpose.body.registration import Registration
from anchorpose.body.skin_points import pose_points
from anchorpose.geodesics.anchors import no_anchors
from anchorpose.joints import ANCHOR_NAMES
from anchorpose.recording.recording import FrameSet
from anchorpose.tracker import limb_watch
from anchorpose.tracker.config import TrackConfig
from anchorpose.tracker.limb_watch import LONGEST_PAUSE, MISNAMED, SEARCH_PAUSE, LimbWatch, is_doubtful
from anchorpose.tracker.observation import DESCRIBED_EVERY, is_described

BODY = adult_body()
POSE = standing()
FOUND = Registration(vague_belief(POSE), 1.0, True)
TIPS = pose_points(BODY, POSE).points_m[anchor_points(BODY.points)]


def explained(uncovered_m2: float) -> SimpleNamespace:
    """An explanation in which every limb is seen."""
    return SimpleNamespace(uncovered_m2=uncovered_m2, covering=np.ones(len(BODY.rest_m), dtype=bool))


def seen(places_m: np.ndarray = TIPS, frame: int = 0) -> SimpleNamespace:
    anchors = replace(no_anchors(), position_m=places_m, node=np.arange(5, dtype=np.int32))
    return SimpleNamespace(
        anchors=anchors,
        evidence=SimpleNamespace(views=()),
        seen_anchors=None,
        surface=range(1000),
        frame_set=SimpleNamespace(frame=frame, position=frame),
    )


def test_a_covered_frame_whose_anchors_are_where_the_body_has_them_is_in_no_doubt():
    assert not is_doubtful(BODY, FOUND, explained(0.9 * LOOK_AGAIN_M2), seen(), tuple(Source))
    assert not is_doubtful(BODY, FOUND, explained(0.0), seen(np.full((5, 3), np.nan)), tuple(Source))


def test_uncovered_skin_is_a_doubt_and_less_of_it_where_a_limb_is_hidden():
    assert is_doubtful(BODY, FOUND, explained(1.1 * LOOK_AGAIN_M2), seen(), tuple(Source))
    hidden = explained(0.6 * LOOK_AGAIN_M2)
    assert not is_doubtful(BODY, FOUND, hidden, seen(), tuple(Source))
    hidden.covering[:] = False
    assert is_doubtful(BODY, FOUND, hidden, seen(), tuple(Source))


@pytest.mark.parametrize("name", ANCHOR_NAMES)
def test_a_hand_or_foot_that_is_elsewhere_is_a_doubt(name):
    """The head moves little, and its anchor is a cap on hair: it has no say."""
    places = TIPS.copy()
    places[ANCHOR_NAMES.index(name), 0] += 0.3
    assert is_doubtful(BODY, FOUND, explained(0.0), seen(places), tuple(Source)) == (name != "Head")


def test_a_source_that_is_switched_off_casts_no_doubt():
    without = {off: [source for source in Source if source is not off] for off in Source}
    places = TIPS.copy()
    places[ANCHOR_NAMES.index("HandLeft"), 0] += 0.3
    assert not is_doubtful(BODY, FOUND, explained(1.0), seen(), without[Source.SURFACE])
    assert not is_doubtful(BODY, FOUND, explained(0.0), seen(places), without[Source.ANCHORS])
    assert is_doubtful(BODY, FOUND, explained(1.0), seen(places), without[Source.ANCHORS])
    assert is_doubtful(BODY, FOUND, explained(1.0), seen(places), without[Source.SURFACE])


@pytest.fixture
def searches(monkeypatch) -> list[float]:
    """The uncovered area of each frame in which limbs are searched for; no search finds anything."""
    tried: list[float] = []

    def search(body, found, predicted, evidence, config, geodesics):
        tried.append(limb_watch.explained_by(body, found, None).uncovered_m2)
        return Search(found, False)

    monkeypatch.setattr(limb_watch, "search_limbs", search)
    monkeypatch.setattr(limb_watch, "named_nats", lambda *_: np.ones((5, 2)))
    return tried


def watch_frames(monkeypatch, areas_m2: list[float], config: TrackConfig = TrackConfig()) -> None:  # noqa: B008
    watch = LimbWatch(SimpleNamespace(config=config))
    for frame, area in enumerate(areas_m2):
        monkeypatch.setattr(limb_watch, "explained_by", lambda *_, area=area: explained(area))
        search = watch.look(BODY, FOUND, explained(area), FOUND.belief, seen(frame=frame))
        assert search is None or search.registration is FOUND


def test_a_search_that_finds_nothing_waits_longer_each_time(monkeypatch, searches):
    watch_frames(monkeypatch, [0.01] * 60)
    first = 1 + (1 + SEARCH_PAUSE) + (1 + 2 * SEARCH_PAUSE)
    assert len(searches) == 3 + (60 - first) // (1 + LONGEST_PAUSE)


def test_much_more_uncovered_skin_is_searched_at_once(monkeypatch, searches):
    watch_frames(monkeypatch, [0.01, 0.012, 0.02, 0.02])
    assert searches == [0.01, 0.02]


def test_a_frame_without_doubt_is_not_searched(monkeypatch, searches):
    watch_frames(monkeypatch, [0.0] * 5)
    assert searches == []


def test_a_limb_that_the_descriptor_names_otherwise_is_searched_for_and_asked_about_now_and_then(monkeypatch, searches):
    asked = list[int]()
    nats = np.full((5, 2), 2.0)

    def named(*_):
        asked.append(1)
        return nats

    monkeypatch.setattr(limb_watch, "named_nats", named)
    watch_frames(monkeypatch, [0.0] * (DESCRIBED_EVERY + 2))
    assert (len(asked), searches) == (2, [])
    nats[3] = [1.0, 1.1 * MISNAMED - 1.0]
    watch_frames(monkeypatch, [0.0])
    assert searches == [0.0]
    blind = TrackConfig(registration=RegistrationConfig(sources=(Source.SURFACE, Source.ANCHORS)))
    watch_frames(monkeypatch, [0.0], blind)
    assert searches == [0.0]


@pytest.mark.parametrize("numbers", [range(40), range(1, 80, 2), range(3, 240, 6)])
def test_every_eighth_frame_is_described_however_the_images_are_numbered(numbers):
    sets = [FrameSet(frame=n, time_s=0.1 * k, depths_m=(None,), position=k) for k, n in enumerate(numbers)]
    assert [one.position for one in sets if is_described(one)] == [0, 8, 16, 24, 32]
