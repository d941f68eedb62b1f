"""Judge the paper's claims about matches of nodes and times (Figs. "appearance" and "mesh", Sections II, III and V)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from anchorpose.research.experiment.config import Scene, Update
from anchorpose.research.experiment.correspondence import REGIONS
from anchorpose.research.experiment.method import PROPOSED, Family, Method
from anchorpose.research.experiment.page.matching_tables import PAPER_FEATURE_S, PAPER_MESH_S, PAPER_NODES
from anchorpose.research.experiment.page.selection import (
    Matching,
    Tracking,
    error_of,
    in_regions,
    mirrored_of,
    penalised_mm,
    tree_mm,
)
from anchorpose.research.experiment.page.tables import Estimate, Unit, mean_over, median_over, ratio_of
from anchorpose.research.experiment.page.tracking_claims import CONSTANT
from anchorpose.research.experiment.page.verdict import Answer, Check, Claim, at_least, at_most, measured
from anchorpose.research.experiment.results import MISSED_MM, ExperimentResults

# Minimum number of nodes of the timed mesh, as a share of the number of nodes of the paper's mesh. With a smaller mesh,
# the claim about times stays undecided.
COMPARABLE: Final = 0.8
# Maximum ratio of the error at head and neck to the error elsewhere. Up to this ratio, the error at head and neck is
# clearly less, as the claim requires.
CLEARLY_LESS: Final = 0.8
# Minimum share of the matches of hands (or feet) that lie on the opposite hand (or foot), for the word "often" in the
# claim. If matches were random, 1 in 40 would lie on the opposite hand (or foot).
OFTEN: Final = 0.1
INACCURATE_MM: Final = 100.0  # mm, minimum median error to be called inaccurate: twice the paper's bound for anchors
SYMMETRIC: Final = ("hand", "foot")
NAMES: Final = tuple(REGIONS)
RIVALS: Final = (Family.LOCAL, Family.SPECTRAL)


class MatchingClaims:
    """The claims about matches, each judged by the results."""

    def __init__(self, results: ExperimentResults) -> None:
        self._matching, self._tracking = Matching(results), Tracking(results)
        self._resamples = results.config.resamples
        self._methods = {method.key: method for method in self._matching.methods}

    def all(self) -> list[Claim]:
        """Return all claims about matches, in the order of the page."""
        return [
            self.local_distinctive(),
            self.best_in_head(),
            self.swapped(),
            self.inaccurate_elsewhere(),
            self.spectral_inaccurate(),
            self.like_gmds(),
            self.dijkstra_suffices(),
        ]

    def local_distinctive(self) -> Claim:
        """Judge the claim of Fig. result2 that local features are accurate only at distinctive places.

        The claim is judged by errors of matches, since errors of joints depend less on the feature: the fit of body
        parts to the surface corrects joints even if matches are wrong.
        """
        inside = [NAMES.index("head")]
        outside = [index for index in range(len(NAMES)) if index not in inside]
        checks = []
        for method in self._of(Family.LOCAL):
            take = error_of(self._matching, method.key)
            above, below = (
                list(self._matching.values(method.key, in_regions(take, part)).values()) for part in (inside, outside)
            )
            value = ratio_of(above, below, self._resamples)
            checks.append(
                Check(f"{method.title}, head and neck over the rest", value, Unit.RATIO, at_most(value, CLEARLY_LESS))
            )
        return Claim(
            "local-distinctive",
            "Fig. “result2” and its caption",
            "Local features are accurate only at distinctive places, such as head and neck.",
            f"Mean error of the matches at head and neck at most {CLEARLY_LESS} times that elsewhere.",
            tuple(checks),
        )

    def best_in_head(self) -> Claim:
        """Judge the claim of Section VI-A that shape features (local and spectral) match best at the head."""
        checks = []
        for method in self._of(*RIVALS):
            parts = [(name, self._region_ratio(method, name)) for name in NAMES if name != "head"]
            closest, value = max(parts, key=lambda part: -1.0 if np.isnan(part[1].mean) else part[1].mean)
            checks.append(
                Check(
                    f"{method.title}, head over {closest}, its next best region", value, Unit.RATIO, at_most(value, 1.0)
                )
            )
        return Claim(
            "best-in-head",
            "Section VI-A, Figs. “appearance” and “mesh”",
            "Shape features match best at the head, whose curvature is stable.",
            "The mean error in the head over that in the next best region is at most 1.",
            tuple(checks),
        )

    def _region_ratio(self, method: Method, name: str) -> Estimate:
        take = error_of(self._matching, method.key)
        above, below = (
            list(self._matching.values(method.key, in_regions(take, [NAMES.index(region)])).values())
            for region in ("head", name)
        )
        return ratio_of(above, below, self._resamples)

    def swapped(self) -> Claim:
        """Judge the claim of Section VI-A that shape features often confuse left and right hands and feet."""
        checks = []
        for method in self._of(*RIVALS):
            for name in SYMMETRIC:
                take = in_regions(mirrored_of, [NAMES.index(name)])
                value = mean_over(list(self._matching.values(method.key, take).values()), self._resamples)
                what = f"{method.title}, {name} matched on the other side"
                checks.append(Check(what, value, Unit.SHARE, at_least(value, OFTEN)))
        return Claim(
            "swapped",
            "Section VI-A",
            "Hands and feet are distinctive too, but left and right are often confused.",
            f"At least {100 * OFTEN:.0f} % of their matches are on the other hand or foot.",
            tuple(checks),
        )

    def inaccurate_elsewhere(self) -> Claim:
        """Judge the claim of Section VI-A that shape features are inaccurate outside of head, hands and feet."""
        elsewhere = [index for index, name in enumerate(NAMES) if name not in ("head", *SYMMETRIC)]
        return Claim(
            "inaccurate-elsewhere",
            "Section VI-A",
            "On the rest of the body these features are inaccurate: it deforms, and its curvature is similar.",
            f"Median error outside head, hands and feet at least {INACCURATE_MM:.0f} mm.",
            tuple(self._inaccuracy(self._of(*RIVALS), elsewhere)),
        )

    def spectral_inaccurate(self) -> Claim:
        """Judge the claim of Section II that spectral features give many inaccurate matches."""
        proposed = [self._methods[PROPOSED]] if PROPOSED in self._methods else []
        context = [check.text() for check in self._inaccuracy(proposed, range(len(NAMES)))]
        return Claim(
            "spectral-inaccurate",
            "Section II",
            "Features from the surface’s spectrum are robust in theory, but give many inaccurate matches in practice.",
            f"Median error at least {INACCURATE_MM:.0f} mm.",
            tuple(self._inaccuracy(self._of(Family.SPECTRAL), range(len(NAMES)))),
            tuple(context),
        )

    def _inaccuracy(self, methods: Sequence[Method], regions: Sequence[int]) -> list[Check]:
        checks = []
        for method in methods:
            take = in_regions(error_of(self._matching, method.key), regions)
            value = median_over(list(self._matching.values(method.key, take).values()), self._resamples)
            checks.append(Check(f"{method.title}, median error", value, Unit.MM, at_least(value, INACCURATE_MM)))
        return checks

    def like_gmds(self) -> Claim:
        """Judge the claim of Section IV-A that distances to a few anchors approximate GMDS (matching by all
        distances).
        """
        return Claim(
            "like-gmds",
            "Section IV-A",
            "Distances to a few anchors can replace all distances: the feature approximates GMDS.",
            f"Mean error of the matches, and of the joints, at most {CONSTANT} times GMDS’s.",
            tuple(self._against(PROPOSED, "gmds", "anchor geodesics over GMDS")),
            self._matched_shares([PROPOSED, "gmds"]),
        )

    def dijkstra_suffices(self) -> Claim:
        """Judge whether shortest paths along the mesh's edges are accurate enough; the paper does not say how distances
        are computed.
        """
        return Claim(
            "dijkstra-suffices",
            "this project’s own question",
            "Shortest paths along the mesh’s edges (Dijkstra) are accurate enough for the feature.",
            f"Mean error of the matches, and of the joints, at most {CONSTANT} times that by fast marching.",
            tuple(self._against("anchors-dijkstra", PROPOSED, "Dijkstra over fast marching")),
            self._matched_shares(["anchors-dijkstra", PROPOSED]),
        )

    def _against(self, one: str, other: str, what: str) -> list[Check]:
        checks = []
        if one in self._methods and other in self._methods:
            above, below = (list(self._matching.values(key, penalised_mm).values()) for key in (one, other))
            checks.append(
                _ratio_check(
                    f"{what}, matches after the tree, a missing one counting {MISSED_MM:.0f} mm",
                    ratio_of(above, below, self._resamples),
                )
            )
        holes = self._tracking.holes(Scene.PAPER)
        if any(self._tracking.pairs(Scene.PAPER, (one, hole), (other, hole)) for hole in holes):
            checks.append(_ratio_check(f"{what}, joints", self._joint_ratio(one, other)))
        return checks

    def _matched_shares(self, keys: Sequence[str]) -> tuple[str, ...]:
        """Return texts with each method's share of matched nodes. The reader needs this share to judge the errors,
        since a method that matches only easy nodes may have a lower error.
        """
        lines = []
        for key in keys:
            if key in self._methods:
                matched = self._matching.values(key, lambda match: np.isfinite(tree_mm(match)).astype(float))
                value = mean_over(list(matched.values()), self._resamples)
                lines.append(Check(f"{self._methods[key].title}, nodes matched", value, Unit.SHARE, Answer.OPEN).text())
        return tuple(lines)

    def _joint_ratio(self, one: str, other: str) -> Estimate:
        """Return the mean joint error of the method ``one`` divided by that of the method ``other``, in the same frames
        of all hole sizes.
        """
        above: dict[str, list[np.ndarray]] = {}
        below: dict[str, list[np.ndarray]] = {}
        for hole in self._tracking.holes(Scene.PAPER):
            pairs = self._tracking.pairs(Scene.PAPER, (one, hole), (other, hole))
            for recording, (first, second) in pairs.items():
                above.setdefault(recording, []).append(first)
                below.setdefault(recording, []).append(second)
        return ratio_of(
            [np.concatenate(arrays) for arrays in above.values()],
            [np.concatenate(arrays) for arrays in below.values()],
            self._resamples,
        )

    def _of(self, *families: Family) -> list[Method]:
        """Return the methods of these families, except methods that update the whole pose by a filter: such methods
        only show the effect of the filter.
        """
        every = self._methods.values()
        return [method for method in every if method.family in families and method.update is Update.PARTS]


def _ratio_check(what: str, value: Estimate) -> Check:
    answer = at_most(value, CONSTANT) if value.count else Answer.OPEN
    return Check(what, value, Unit.RATIO, answer)


def paper_times(results: ExperimentResults) -> Claim:
    """Judge the paper's claim about its times for the mesh and the feature (Section VI-B)."""
    checks, times = [], results.times
    if times is not None:
        enough = times.nodes >= COMPARABLE * PAPER_NODES
        for what, seconds, bound in (
            ("mesh", times.mesh_s, PAPER_MESH_S),
            ("feature by Dijkstra", times.dijkstra_s, PAPER_FEATURE_S),
            ("feature by fast marching", times.feature_s, PAPER_FEATURE_S),
        ):
            value = Estimate(seconds, np.nan, np.nan, 1)
            answer = measured(seconds, bound) if enough else Answer.OPEN
            checks.append(Check(f"{what}, {times.nodes} nodes (paper: {bound} s)", value, Unit.SECONDS, answer))
    return Claim(
        "times",
        "Section VI-B",
        "One core builds a mesh of 15,549 nodes in 0.72 s, and the feature of five anchors in 0.23 s.",
        f"No longer than the paper’s, on a mesh of at least {COMPARABLE:g} times as many nodes; another processor.",
        tuple(checks),
    )
