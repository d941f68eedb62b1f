"""Define the paper's method, exactly as the paper's text describes the method.

The method's anchors are the paper's extrema. For each subset of three anchors, a node's match is the node nearest to
the average of psi, the set of nodes with similar distances to these anchors. The paper's tree chooses among these
matches, and ICP registers each body part. docs/experiment.md states each choice that the text leaves open.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import Final

import numpy as np

from anchorpose.research.experiment.config import Update
from anchorpose.research.experiment.method import LITERAL, Family, Method
from anchorpose.research.experiment.methods.anchors import (
    PAPER_SUBSET,
    SOURCE,
    AnchorSetting,
    all_hypotheses,
    by_psi,
    next_frame_only,
)
from anchorpose.research.features.paper_anchors import paper_descriptor
from anchorpose.tracker.observation import Observation


def _describe(seen: Observation) -> np.ndarray:
    return paper_descriptor(seen.whole, seen.anchors)[: len(seen.surface)]


AS_WRITTEN: Final = AnchorSetting(unclipped=False, pieces=False)

_LITERAL = Method(
    key=LITERAL,
    title="the paper's method, literal",
    family=Family.PROPOSED,
    source=SOURCE,
    settings=(AS_WRITTEN,),
    associate=partial(by_psi, _describe, PAPER_SUBSET),
    configure=all_hypotheses,
    several=True,
    frame_ms=120.0,
)

METHODS = (
    _LITERAL,
    replace(
        _LITERAL,
        key="paper-squared",
        title="the same, psi by the squared norm as printed",
        settings=(replace(AS_WRITTEN, squared=True),),
    ),
    replace(
        _LITERAL,
        key="paper-kalman",
        title="the paper's matches with a Kalman filter",
        configure=next_frame_only,
        update=Update.KALMAN,
    ),
    replace(
        _LITERAL,
        key="paper-particles",
        title="the paper's matches with a particle filter",
        configure=next_frame_only,
        update=Update.PARTICLES,
        frame_ms=300.0,
    ),
)
