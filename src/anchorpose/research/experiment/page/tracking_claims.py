"""Judge the paper's claims, and this project's, about the errors of tracked joints (Figs. "result1" to "sd2")."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from anchorpose.joints import JOINT_NAMES
from anchorpose.research.experiment.config import Form, Scene, Update
from anchorpose.research.experiment.method import LITERAL, NEXT, OWN, PROPOSED, Family, Method
from anchorpose.research.experiment.page.form_tables import FORM_NAMES
from anchorpose.research.experiment.page.selection import Tracking, compared, frame_means
from anchorpose.research.experiment.page.tables import Estimate, Unit, mean_over, ratio_of
from anchorpose.research.experiment.page.tracking_tables import errors_of_all_sizes, ratio_to_none
from anchorpose.research.experiment.page.verdict import Answer, Check, Claim, at_most, between
from anchorpose.research.experiment.results import ExperimentResults

# largest ratio of the error with a hole to the error without a hole for an error that counts as "almost constant"
CONSTANT: Final = 1.1
SIMILAR: Final = 2.0  # largest ratio of the worst joint's error to the best joint's error that counts as "similar"
# mm, largest mean joint error that counts as "adequate": a forearm's width, so that the joint is on the correct limb
ADEQUATE_MM: Final = 100.0


FILTERS: Final = {PROPOSED: ("anchors-filter",), LITERAL: ("paper-kalman", "paper-particles")}
"""Keys of methods with a filter instead of the track tree, by the key of the method whose matches they use."""


def literal_claims(results: ExperimentResults) -> list[Claim]:
    """Return the paper's claims about its feature, judged by the results of the method ``LITERAL`` (the paper's method,
    exactly as its text describes it) in the form of the paper's framework that rejects no matches.

    The list is empty if this method did not run.
    """
    if all(method.key != LITERAL for method in results.methods):
        return []
    of_text = TrackingClaims(results, LITERAL, Form.REFINED_ALL)
    return [
        replace(claim, key=f"literal-{claim.key}", text=f"{claim.text} The literal method, nothing rejected.")
        for claim in of_text.of_the_feature()
    ]


class TrackingClaims:
    """The claims about the errors of tracked joints, each judged by the results of the experiment.

    proposed: key of the method that stands for the paper's method. form: form (variant) of the paper's framework whose
    results are used.
    """

    def __init__(self, results: ExperimentResults, proposed: str = PROPOSED, form: Form = Form.REFINED) -> None:
        self._results, self._tracking, self._resamples = results, Tracking(results, form), results.config.resamples
        self._proposed = proposed
        self._methods = self._tracking.ran(Scene.PAPER, compared(results.methods))
        self._holes = self._tracking.holes(Scene.PAPER)

    def of_the_feature(self) -> list[Claim]:
        """Return only the claims about the feature that the paper proposes, distances to anchors."""
        return [
            self.proposed_constant(),
            self.proposed_below("local", (Family.LOCAL,)),
            self.proposed_below("spectral", (Family.SPECTRAL,)),
            self.proposed_similar(),
            self.proposed_adequate(),
            self.helps_at_all(),
            self.filter_instead(),
        ]

    def all(self) -> list[Claim]:
        """Return all claims about joints, in the order of the page."""
        return [
            self.proposed_constant(),
            self.proposed_below("local", (Family.LOCAL,)),
            self.proposed_below("spectral", (Family.SPECTRAL,)),
            self.local_constant(),
            self.proposed_similar(),
            self.proposed_adequate(),
            self.tree_helps(),
            self.helps_at_all(),
            self.filter_instead(),
            self.next_below_all(),
            self.next_constant(),
            self.own_below_all(),
        ]

    def proposed_constant(self) -> Claim:
        """Judge the claim of Fig. result1 that the proposed feature has almost the same error at every size of hole."""
        return Claim(
            "proposed-constant",
            "Fig. “result1” and its caption",
            "The proposed feature with the tree has almost the same error whatever the size of the hole.",
            f"Error at the largest hole at most {CONSTANT} times that without, in the same frames.",
            tuple(self._constancy([m for m in self._methods if m.key == self._proposed], at_most)),
        )

    def local_constant(self) -> Claim:
        """Judge the claim of Fig. result1 that local features have almost the same errors at every size of hole."""
        return Claim(
            "local-constant",
            "Fig. “result1” and its caption",
            "Local features are insensitive to occlusions: their errors are almost the same at every size.",
            f"Error at the largest hole within {CONSTANT} times that without, either way, in the same frames.",
            tuple(self._constancy(self._of(Family.LOCAL), lambda value, top: between(value, 1 / top, top))),
        )

    def _constancy(self, methods: Sequence[Method], judged: Callable[[Estimate, float], Answer]) -> list[Check]:
        if len(self._holes) < 2:
            return []
        top, checks = self._holes[-1], []
        for method in methods:
            for which, occluded in (("all frames", False), ("frames with a hole", True)):
                value = ratio_to_none(self._tracking, method.key, top, self._resamples, occluded)
                what = f"{method.title}, {top:.2f} m over none, {which}"
                checks.append(Check(what, value, Unit.RATIO, judged(value, CONSTANT)))
        return checks

    def proposed_below(self, name: str, families: Sequence[Family]) -> Claim:
        """Judge the claim of Fig. result1 (Section VI-B) that the proposed feature is more accurate than ``families``.

        name: name of these families in texts.
        """
        others = self._of(*families)
        return Claim(
            f"proposed-below-{name}",
            "Fig. “result1”, Section VI-B",
            f"At every size of hole the proposed feature with the tree is more accurate than every {name} feature.",
            "The proposed method’s error minus the other’s, in the same frames, is below 0.",
            tuple(self._below(self._proposed, others)),
        )

    def helps_at_all(self) -> Claim:
        """Judge whether the paper's framework tracks better with the proposed feature than without any feature."""
        return Claim(
            "helps-at-all",
            "this project’s own question",
            "The proposed feature tracks better than the framework without any feature.",
            "The proposed method’s error minus the other’s, in the same frames, is below 0.",
            tuple(self._below(self._proposed, self._of(Family.NONE))),
        )

    def filter_instead(self) -> Claim:
        """Judge whether a filter can replace the track tree (Section III: "EKF, UKF, or particle tracking filter")."""
        others = [method for method in self._methods if method.key in FILTERS[self._proposed]]
        return Claim(
            "tree-below-filter",
            "Section III (commented out)",
            "The track tree is more accurate than a filter over the pose on the same matches.",
            "The proposed method’s error minus that with the filter, in the same frames, is below 0.",
            tuple(self._below(self._proposed, others)),
        )

    def next_below_all(self) -> Claim:
        """Judge the claim about future work (Section VII): anchors with a local descriptor are the most accurate."""
        checks = []
        for form in self._results.config.forms:
            tracking = Tracking(self._results, form)
            others = [m for m in self._methods if m.family is not Family.TRACKER and m.key != NEXT]
            checks += self._below(NEXT, others, tracking=tracking, after=f", {FORM_NAMES[form]}")
        return Claim(
            "next-below-all",
            "Section VII (future work)",
            "Anchors together with a local descriptor are more accurate than every other method in the framework, at "
            "every size of hole and in every form.",
            "Its error minus the other’s, in the same frames, is below 0.",
            tuple(checks),
        )

    def next_constant(self) -> Claim:
        """Judge the claim of "greater invariance": the method "next generation" has almost the same error at all sizes
        of hole.
        """
        return Claim(
            "next-constant",
            "Section VII (future work)",
            "Anchors together with a local descriptor have almost the same error whatever the size of the hole.",
            f"Error at the largest hole at most {CONSTANT} times that without, in the same frames.",
            tuple(self._constancy([m for m in self._methods if m.key == NEXT], at_most)),
        )

    def own_below_all(self) -> Claim:
        """Judge the claim that this project's tracker is more accurate than every method in the paper's framework."""
        others = [method for method in self._methods if method.key != OWN]
        return Claim(
            "own-below-all",
            "this project’s own",
            "anchorpose’s tracker is more accurate than every method in the paper’s framework, at every size of hole.",
            "Its error minus the other’s, in the same frames, is below 0.",
            tuple(self._below(OWN, others)),
        )

    def tree_helps(self) -> Claim:
        """Judge the claim of Section V that the track tree, which chooses matches with the help of later frames,
        improves tracking in frames with a hole.
        """
        others = [method for method in self._methods if method.key == "anchors-no-tree"]
        return Claim(
            "tree-helps",
            "Section V and abstract",
            "Hypotheses from subsets of anchors, chosen by a tree over several frames, make tracking better under "
            "occlusion.",
            "In frames with a hole, the error with the tree less that without is below 0.",
            tuple(self._below(self._proposed, others, occluded=True)),
        )

    def proposed_similar(self) -> Claim:
        """Judge the claim of Fig. result2 that the proposed feature has similar errors at all joints."""
        checks = [
            Check(what, value, Unit.RATIO, at_most(value, SIMILAR))
            for method in self._methods
            if method.key == self._proposed
            for what, value in [self._spread(method)]
        ]
        return Claim(
            "proposed-similar",
            "Fig. “result2” and its caption",
            "The proposed feature has similar errors at all joints.",
            f"The worst joint’s error at most {SIMILAR:g} times the best one’s, over all sizes.",
            tuple(checks),
            self._spread_lines(self._of(Family.LOCAL, Family.SPECTRAL)),
        )

    def _spread(self, method: Method) -> tuple[str, Estimate]:
        errors = list(errors_of_all_sizes(self._tracking, method.key).values())
        means = [mean_over([e[:, joint] for e in errors], 1).mean for joint in range(len(JOINT_NAMES))]
        if np.isnan(means).all():
            return method.title, Estimate(np.nan, np.nan, np.nan, 0)
        worst, best = int(np.nanargmax(means)), int(np.nanargmin(means))
        value = ratio_of([e[:, [worst]] for e in errors], [e[:, [best]] for e in errors], self._resamples)
        return f"{method.title}, {JOINT_NAMES[worst]} over {JOINT_NAMES[best]}", value

    def _spread_lines(self, methods: Sequence[Method]) -> tuple[str, ...]:
        return tuple(Check(*self._spread(method), Unit.RATIO, Answer.OPEN).text() for method in methods)

    def proposed_adequate(self) -> Claim:
        """Judge the claim of Fig. mhtjoints that joints are accurate enough although some matches are wrong."""
        checks = []
        for hole in self._holes:
            value = mean_over(list(self._tracking.errors(Scene.PAPER, self._proposed, hole).values()), self._resamples)
            what = f"mean joint error, {_hole_text(hole)}"
            checks.append(Check(what, value, Unit.MM, at_most(value, ADEQUATE_MM)))
        return Claim(
            "proposed-adequate",
            "Fig. “mhtjoints”, Section VI-A",
            "Some matches are wrong under occlusion, yet the joints are found well enough.",
            f"Mean joint error at most {ADEQUATE_MM:.0f} mm, a forearm’s width; the paper gives no bound.",
            tuple(checks),
        )

    def _below(
        self,
        key: str,
        others: Sequence[Method],
        occluded: bool = False,
        tracking: Tracking | None = None,
        after: str = "",
    ) -> list[Check]:
        tracking = tracking or self._tracking
        ran = {method.key for method in tracking.ran(Scene.PAPER, [*self._methods])}
        if key not in ran:
            return []
        checks = []
        for method in others:
            for hole in tracking.holes(Scene.PAPER):
                if (occluded and hole == 0) or not tracking.runs(Scene.PAPER, key, hole):
                    continue
                value = difference(tracking, key, method.key, hole, self._resamples, occluded)
                what = f"minus {method.title}, {_hole_text(hole)}{after}"
                checks.append(Check(what, value, Unit.MM, below_zero(value)))
        return checks

    def _of(self, *families: Family) -> list[Method]:
        """Return the methods of these families, except methods that update the whole pose by a filter: such methods
        only show the effect of the filter.
        """
        every = self._methods
        return [method for method in every if method.family in families and method.update is Update.PARTS]


def difference(
    tracking: Tracking, one: str, other: str, hole_m: float, resamples: int, occluded: bool = False
) -> Estimate:
    """Return the mean joint error of the method ``one`` minus that of the method ``other``, in mm.

    A joint in a frame counts only if its error is known for both methods.
    """
    pairs = tracking.pairs(Scene.PAPER, (one, hole_m), (other, hole_m), occluded).values()
    return mean_over([frame_means(first - second) for first, second in pairs], resamples)


def below_zero(value: Estimate) -> Answer:
    """Return yes if the whole interval is below 0, no if the whole interval is at or above 0, else open."""
    if np.isnan(value.low):
        return Answer.OPEN
    if value.high < 0:
        return Answer.YES
    return Answer.NO if value.low >= 0 else Answer.OPEN


def _hole_text(hole_m: float) -> str:
    return f"hole of {hole_m:.2f} m" if hole_m else "no hole"
