"""Select the frames and matches of an experiment so that all methods are compared on the same data."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from anchorpose.joints import JOINT_NAMES
from anchorpose.research.experiment.config import Form, Scene
from anchorpose.research.experiment.method import OWN, Family, Method
from anchorpose.research.experiment.results import MISSED_MM, ExperimentResults, Matched, Tracked

Kept = Mapping[tuple[str, float], np.ndarray]
"""The frames on which methods are compared, in ascending order, by recording and size of hole (m)."""


def compared(methods: Iterable[Method]) -> list[Method]:
    """Return all methods except the ablated variants of anchorpose's tracker."""
    return [method for method in methods if method.family is not Family.TRACKER or method.key == OWN]


def ablated(methods: Iterable[Method]) -> list[Method]:
    """Return anchorpose's tracker and its ablated variants."""
    return [method for method in methods if method.family is Family.TRACKER]


def frame_means(error_mm: np.ndarray) -> np.ndarray:
    """Return the mean error of each frame (f,) over the joints (f, j) with an error; NaN if no joint has an error."""
    known = np.isfinite(error_mm)
    count = known.sum(axis=1)
    total = np.where(known, error_mm, 0.0).sum(axis=1)
    means: np.ndarray = np.divide(total, count, out=np.full(len(count), np.nan), where=count > 0)
    return means


HANDS: Final = tuple(index for index, name in enumerate(JOINT_NAMES) if name.startswith(("Hand", "Wrist")))
"""Indices of hands and wrists, which move most; their errors are the largest part of every mean over all joints."""


def without_hands(error_mm: np.ndarray) -> np.ndarray:
    """Return the errors (f, 17) of all joints except hands and wrists, from the errors (f, 21) of all joints."""
    return np.delete(error_mm, HANDS, axis=1)


class Tracking:
    """The results of tracking in one form (variant) of the paper's framework, by scene, method and size of hole.

    Recordings are sorted by name. This project's tracker runs outside the paper's framework, so its results are
    included whatever the form.
    """

    def __init__(self, results: ExperimentResults, form: Form = Form.REFINED) -> None:
        own = {method.key for method in results.methods if method.family is Family.TRACKER}
        self._runs: dict[tuple[Scene, str, float], dict[str, Tracked]] = defaultdict(dict)
        for run in sorted(results.tracked, key=lambda run: run.recording):
            if run.form is form or run.method in own:
                self._runs[run.scene, run.method, run.hole_m][run.recording] = _in_order(run)

    def holes(self, scene: Scene) -> list[float]:
        """Return the radii in metres of the holes that were cut into a scene's depth images; 0 = no hole."""
        return sorted({hole for of, _, hole in self._runs if of is scene})

    def ran(self, scene: Scene, methods: Iterable[Method]) -> list[Method]:
        """Return the methods that tracked a frame in the scene."""
        keys = {
            key
            for (of, key, _), runs in self._runs.items()
            if of is scene and any(len(run.frame) for run in runs.values())
        }
        return [method for method in methods if method.key in keys]

    def runs(self, scene: Scene, method: str, hole_m: float) -> dict[str, Tracked]:
        """Return the tracked joints of a method by recording, for one scene and size of hole."""
        return self._runs.get((scene, method, hole_m), {})

    def shared(self, scene: Scene, methods: Iterable[Method]) -> Kept:
        """Return the frames on which all these methods ran; methods that tracked no frame of the scene are ignored."""
        keys = [method.key for method in self.ran(scene, methods)]
        kept: dict[tuple[str, float], np.ndarray] = {}
        for hole in self.holes(scene):
            runs = [self.runs(scene, key, hole) for key in keys]
            for recording in sorted(set.intersection(*(set(run) for run in runs)) if runs else ()):
                frames = [run[recording].frame for run in runs]
                kept[recording, hole] = np.array(sorted(set.intersection(*(set(f.tolist()) for f in frames))), int)
        return kept

    def errors(
        self, scene: Scene, method: str, hole_m: float, kept: Kept | None = None, occluded: bool = False
    ) -> dict[str, np.ndarray]:
        """Return a method's joint errors (f, 21) in millimetres by recording.

        kept: return only the errors in these frames; None = in all frames. occluded: return only errors in frames with
        a hole.
        """
        found = {}
        for recording, run in self.runs(scene, method, hole_m).items():
            chosen = run.occluded.copy() if occluded else np.ones(len(run.frame), bool)
            if kept is not None:
                chosen &= np.isin(run.frame, kept.get((recording, hole_m), np.empty(0, int)))
            found[recording] = run.error_mm[chosen]
        return found

    def pairs(
        self,
        scene: Scene,
        one: tuple[str, float],
        other: tuple[str, float],
        occluded: bool = False,
        kept: Kept | None = None,
    ) -> dict[str, tuple[np.ndarray, np.ndarray]]:
        """Return the errors (f, 21) in millimetres of two runs in the same frames, by recording.

        A run is a method and a size of hole. occluded: only frames that have a hole in the first run. kept: only these
        frames; None = all. Recordings that one of the runs lacks are left out.
        """
        found = {}
        ones, others = self.runs(scene, *one), self.runs(scene, *other)
        for recording in sorted(set(ones) & set(others)):
            first, second = ones[recording], others[recording]
            frames = first.frame[first.occluded] if occluded else first.frame
            for hole_m in (one[1], other[1]) if kept is not None else ():
                frames = frames[np.isin(frames, (kept or {}).get((recording, hole_m), np.empty(0, int)))]
            frames = np.intersect1d(frames, second.frame)
            rows = [np.searchsorted(run.frame, frames) for run in (first, second)]
            found[recording] = (first.error_mm[rows[0]], second.error_mm[rows[1]])
        return found


def left_out(results: ExperimentResults) -> tuple[int, int]:
    """Return two numbers: the planned segments of the simulated recordings on which no method ran, and all planned
    segments.
    """
    config, ran = results.config, dict[tuple[Scene, str], int]()
    for run in results.tracked:
        if run.scene is not Scene.REAL:
            segments = len(run.frame) // (config.segment_frames - 1)
            ran[run.scene, run.recording] = max(segments, ran.get((run.scene, run.recording), 0))
    wanted = sum(config.segments_of(scene) for scene, _ in ran)
    return wanted - sum(ran.values()), wanted


def _in_order(run: Tracked) -> Tracked:
    order = np.argsort(run.frame, kind="stable")
    if (np.diff(run.frame[order]) == 0).any():
        raise ValueError(f"{run.method} on {run.recording} has a frame twice")
    return replace(run, frame=run.frame[order], occluded=run.occluded[order], error_mm=run.error_mm[order])


WindowKey = tuple[str, float, int]
"""Key of a window (pair of frames whose matches are compared): recording, size of hole and first frame."""


class Matching:
    """All matches in the paper's scene between frames a given time apart, in the windows (pairs of such frames) on
    which all methods ran.
    """

    def __init__(self, results: ExperimentResults, gap_s: float | None = None) -> None:
        """Select the matches of one gap. gap_s: None = the shortest gap."""
        gap_s = min(results.config.gaps_s) if gap_s is None else gap_s
        self._matched: dict[str, dict[WindowKey, Matched]] = defaultdict(dict)
        for match in results.matched:
            if match.scene is Scene.PAPER and match.gap_s == gap_s:
                self._matched[match.method][match.recording, match.hole_m, match.frame] = match
        self.methods = [method for method in results.methods if method.key in self._matched]
        self._direct = {method.key for method in self.methods if not method.several}
        windows = [set(matched) for matched in self._matched.values()]
        self.windows: list[WindowKey] = sorted(set.intersection(*windows)) if windows else []

    def holes(self) -> list[float]:
        """Return the radii in metres of the holes that were cut into depth images; 0 = no hole."""
        return sorted({hole for _, hole, _ in self.windows})

    def has_direct(self, method: str) -> bool:
        """Return whether the method has direct matches, which are made without the track tree.

        A method with several hypotheses has no direct matches, since only the track tree can choose among them.
        """
        return method in self._direct

    def values(
        self, method: str, take: Callable[[Matched], np.ndarray], hole_m: float | None = None
    ) -> dict[str, np.ndarray]:
        """Return the result of ``take`` for a method's matches, by recording; hole_m: None = for all sizes of hole."""
        parts: dict[str, list[np.ndarray]] = defaultdict(list)
        for window in self.windows:
            if hole_m in (None, window[1]):
                parts[window[0]].append(np.atleast_1d(take(self._matched[method][window])))
        return {recording: np.concatenate(arrays) for recording, arrays in parts.items()}


def direct_mm(match: Matched) -> np.ndarray:
    """Return the straight distances (mm) of the direct matches (made without the track tree) from the truth, one per
    node; NaN without a match.
    """
    return match.direct_mm


def tree_mm(match: Matched) -> np.ndarray:
    """Return the straight distances (mm) from the truth to the track tree's matches; NaN without a match."""
    return match.tree_mm


def every_mm(match: Matched) -> np.ndarray:
    """Return the straight distances (mm) from the truth to the matches of a track tree that rejects no match."""
    return match.every_mm


def of_moved(take: Callable[[Matched], np.ndarray]) -> Callable[[Matched], np.ndarray]:
    """Return a function that returns the result of ``take``, but only for the nodes that moved by more than
    ``MOVED_MM``.

    Between neighbouring frames, most nodes hardly move, so a result over all nodes says little about moved nodes.
    """
    return lambda match: take(match)[match.moved_mm > MOVED_MM]


MOVED_MM: Final = 30.0  # mm, movement between the two frames above which a node counts as moved


def penalised_mm(match: Matched) -> np.ndarray:
    """Return the distances of ``tree_mm``, with ``MISSED_MM`` for nodes without a match, so that matching fewer nodes
    does not improve a method's result.
    """
    return np.where(np.isfinite(match.tree_mm), match.tree_mm, MISSED_MM)


def error_of(matching: Matching, method: str) -> Callable[[Matched], np.ndarray]:
    """Return the function that returns the errors of a method's direct matches, which the paper compares, too.

    For a method without direct matches, the function returns the errors of the matches that the track tree chose.
    """
    return direct_mm if matching.has_direct(method) else tree_mm


def mirrored_of(match: Matched) -> np.ndarray:
    """Return for each node: 1 if its match is on the same part of the opposite limb, 0 if not, NaN without a match."""
    matched = np.isfinite(match.direct_mm) | np.isfinite(match.tree_mm)
    return np.where(matched, match.mirrored.astype(np.float64), np.nan)


def in_regions(take: Callable[[Matched], np.ndarray], regions: Sequence[int]) -> Callable[[Matched], np.ndarray]:
    """Return a function that returns the result of ``take``, but only for the nodes in some regions of the body
    (indices into ``REGIONS``).
    """
    return lambda match: take(match)[np.isin(match.region, regions)]
