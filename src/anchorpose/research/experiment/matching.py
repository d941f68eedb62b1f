"""Measure how far matches of nodes (points of the patient's mesh) are from the true correspondence.

Matches are compared in windows. A window is a frame of a recording and the frames of its look-ahead, the next frames
that the track tree uses. In a window, all methods match the same meshes.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from anchorpose.body.pose import Pose
from anchorpose.geodesics.anchors import anchor_descriptor
from anchorpose.geodesics.center import center_field
from anchorpose.geodesics.extrema import geodesic_extrema
from anchorpose.research.experiment.correspondence import Skin, TruePlaces
from anchorpose.research.experiment.framework import NEVER_M, start_at
from anchorpose.research.experiment.given import GivenFrames
from anchorpose.research.experiment.method import Family, Method
from anchorpose.track_tree.global_hypothesis import GlobalHypothesis, global_hypothesis
from anchorpose.track_tree.hypotheses import Matcher
from anchorpose.tracker.config import TrackConfig
from anchorpose.tracker.observation import Observation
from anchorpose.tracker.patient import PatientTracker
from anchorpose.tracker.room import Run


@dataclass(frozen=True, slots=True, eq=False)
class Window:
    """A frame of a recording and the next frames that the track tree uses (its look-ahead), as the tracker observes
    them.
    """

    frame: int  # position of the first frame in the recording
    stride: int  # number of frames from one observation to the next
    tracker: PatientTracker
    observations: tuple[Observation, ...]
    poses: tuple[Pose, ...]  # predicted poses, one for each observation after the first
    config: TrackConfig


@dataclass(frozen=True, slots=True, eq=False)
class Matches:
    """A method's matches of the m nodes of a window's first frame with nodes of its second frame; -1 = no match."""

    direct: np.ndarray  # (m,), match of each node without the track tree; all -1 if nodes have several hypotheses
    links: tuple[Matcher, ...]  # hypotheses (possible matches) from each frame of the window to the next
    tree: GlobalHypothesis  # the track tree's matches; only nodes near the body in its fitted pose have a match
    every: GlobalHypothesis  # as ``tree``, but no match is rejected, however far it is from the node's predicted place
    describe_s: float  # seconds on one core for the first two frames' descriptors and the matches between them


def take_window(frame: int, given: GivenFrames, run: Run, stride: int = 1) -> Window | None:
    """Return the window (the observed frame and the next frames that the track tree uses) that begins with a frame.

    Return None if the patient was not found in this frame, or if the next frame of the window does not exist or does
    not show the patient. stride: number of frames from one observation to the next, as in ``run_in``.
    """
    if not given.reference.found[frame] or frame + stride >= len(given):
        return None
    tracker = start_at(frame, given, run, stride=stride)
    for later in range(frame + stride, min(frame + 1 + stride * run.config.follow.look_ahead, len(given)), stride):
        tracker.step(given.frame(later), only_look=True)
    if tracker.next_hypothesis() is None:
        return None
    poses = tracker.predict(len(tracker.window) - 1)
    return Window(frame, stride, tracker, tuple(tracker.window.seen), tuple(poses), run.config)


def match_window(method: Method, setting: object, window: Window) -> Matches:
    """Return the method's matches in a window: all hypotheses (possible matches), and the matches that the track tree
    chose.
    """
    if method.associate is None:
        raise ValueError(f"{method.key} has no association")
    config, associate = method.configure(window.config, setting), method.associate(setting)
    seen = window.observations[: config.follow.look_ahead + 1]
    began = time.process_time()
    first = associate(seen[0], seen[1], config)
    hypotheses = first.all().match
    describe_s = time.process_time() - began
    links = (first, *(associate(now, after, config) for now, after in pairwise(seen[1:])))
    tracker = window.tracker
    never = replace(config, tree=replace(config.tree, missed_cost_m=NEVER_M))
    tree, every = (
        global_hypothesis(
            tracker.body, tracker.belief.pose, window.poses[: len(links)], seen, links, how.follow.tree_nodes, how.tree
        )
        for how in (config, never)
    )
    direct = (
        hypotheses[:, 0] if not method.several and hypotheses.shape[1] == 1 else np.full(len(hypotheses), -1, np.int32)
    )
    return Matches(direct, links, tree, every, describe_s)


def draw_some(frames: Sequence[int], wanted: int, seed: int) -> list[int]:
    """Draw at most ``wanted`` frames at random, and sort them. The same arguments give the same frames."""
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(11,)))
    count = min(wanted, len(frames))
    return sorted(int(frame) for frame in rng.choice(np.asarray(frames), size=count, replace=False))


# Number of nodes per window whose matches are compared with the truth: enough for an accurate mean, and few enough to
# store the errors of all these nodes.
COMPARED = 400


@dataclass(frozen=True, slots=True, eq=False)
class MatchErrors:
    """The errors of the matches of the m compared nodes of a window (a frame and the next frames). ``results.Matched``
    describes the fields.
    """

    region: np.ndarray
    moved_mm: np.ndarray
    direct_mm: np.ndarray
    tree_mm: np.ndarray
    every_mm: np.ndarray
    direct_skin_mm: np.ndarray
    tree_skin_mm: np.ndarray
    mirrored: np.ndarray
    nodes: int
    describe_s: float


@dataclass(frozen=True, slots=True, eq=False)
class Truth:
    """The true correspondence of the m compared nodes of a window's first frame with its second frame."""

    skin: Skin
    node: np.ndarray  # (m,), node of the first frame
    moved_mm: np.ndarray  # (m,), distance by which each compared node moves from the first to the second frame
    places: TruePlaces  # true place of each compared node in the second frame


def truth_of(window: Window, skin: Skin) -> Truth:
    """Return the truth of at most ``COMPARED`` nodes whose true place is seen in the window's second frame.

    The nodes are drawn at random, but are the same for every method.
    """
    now, after = (seen.surface.points_m.astype(np.float64) for seen in window.observations[:2])
    places = skin.follow(now, window.frame, window.frame + window.stride, after)
    seen = np.flatnonzero(places.seen)
    rng = np.random.default_rng(np.random.SeedSequence(window.frame, spawn_key=(17,)))
    chosen = np.sort(rng.choice(seen, size=min(COMPARED, len(seen)), replace=False))
    moved_mm = (1000.0 * np.linalg.norm(places.place_m[chosen] - now[chosen], axis=1)).astype(np.float32)
    return Truth(skin, chosen, moved_mm, TruePlaces(places.vertex[chosen], places.place_m[chosen], places.seen[chosen]))


def score(method: Method, setting: object, window: Window, truth: Truth) -> MatchErrors:
    """Return the errors of the method's matches from a window's first frame to its second frame."""
    matches = match_window(method, setting, window)
    direct = _matched(matches, window, truth)
    tree, every = (_chosen(one, window, truth) for one in (matches.tree, matches.every))
    skin, frame = truth.skin, window.frame + window.stride
    chosen = np.where(np.isfinite(direct).all(axis=1, keepdims=True), direct, tree)
    return MatchErrors(
        region=skin.region[truth.places.vertex].astype(np.int8),
        moved_mm=truth.moved_mm,
        direct_mm=_straight_mm(direct, truth),
        tree_mm=_straight_mm(tree, truth),
        every_mm=_straight_mm(every, truth),
        direct_skin_mm=_skin_mm(direct, truth, frame),
        tree_skin_mm=_skin_mm(tree, truth, frame),
        mirrored=_mirrored(chosen, truth, frame),
        nodes=len(window.observations[0].surface),
        describe_s=matches.describe_s + _anchors_s(method, setting, window),
    )


def warm_up(method: Method, setting: object, window: Window) -> None:
    """Match two frames once before times are measured, since the first call loads or compiles numba's kernels."""
    if method.associate is not None:
        now, after = window.observations[:2]
        method.associate(setting)(now, after, method.configure(window.config, setting)).all()


def _anchors_s(method: Method, setting: object, window: Window) -> float:
    """Return the seconds on one core to find the anchors (tips of head, hands and feet) in a window's first two frames
    and to compute the distances to the anchors.

    The result is 0 if the method does not use the anchors of the observation.
    """
    if method.family is not Family.PROPOSED:
        return 0.0
    config, start = method.configure(window.config, setting), time.process_time()
    for seen in window.observations[:2]:
        field = center_field(seen.whole).distance_m
        geodesic_extrema(seen.whole, field, config.anchors.radius * window.tracker.height_m)
        anchor_descriptor(seen.whole, seen.anchors)
    return time.process_time() - start


def _chosen(tree: GlobalHypothesis, window: Window, truth: Truth) -> np.ndarray:
    """Return the positions (m, 3) of the matches that a track tree chose for compared nodes; NaN without a match."""
    place = np.full((len(window.observations[0].surface), 3), np.nan)
    place[tree.node] = tree.matched_m
    return place[truth.node]


def _matched(matches: Matches, window: Window, truth: Truth) -> np.ndarray:
    """Return the positions (m, 3) of the compared nodes' direct matches; NaN without a direct match."""
    found = np.full((len(truth.node), 3), np.nan)
    node = matches.direct[truth.node]
    found[node >= 0] = window.observations[1].surface.points_m[node[node >= 0]]
    return found


def _straight_mm(matched_m: np.ndarray, truth: Truth) -> np.ndarray:
    distance: np.ndarray = 1000.0 * np.linalg.norm(matched_m - truth.places.place_m, axis=1)
    return distance.astype(np.float32)


def _skin_mm(matched_m: np.ndarray, truth: Truth, frame: int) -> np.ndarray:
    """Return the distances (m,) of matches from the true places along the skin, in millimetres; NaN without a match.

    The straight distance is returned if it is greater than the distance along the skin, which may be too small, since
    both its ends are known only to the nearest vertex.
    """
    known = np.isfinite(matched_m).all(axis=1)
    distance = np.full(len(matched_m), np.nan, np.float32)
    vertex = truth.skin.vertex_at(matched_m[known], frame)
    along = 1000.0 * truth.skin.along_skin_m(vertex, truth.places.vertex[known])
    distance[known] = np.maximum(along, _straight_mm(matched_m, truth)[known])
    return distance


def _mirrored(matched_m: np.ndarray, truth: Truth, frame: int) -> np.ndarray:
    known = np.isfinite(matched_m).all(axis=1)
    mirrored = np.zeros(len(matched_m), bool)
    vertex = truth.skin.vertex_at(matched_m[known], frame)
    true_vertex, skin = truth.places.vertex[known], truth.skin
    other_side = skin.side[vertex] * skin.side[true_vertex] == -1
    mirrored[known] = other_side & (skin.region[vertex] == skin.region[true_vertex])
    return mirrored
