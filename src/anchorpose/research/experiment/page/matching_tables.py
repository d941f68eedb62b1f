"""Make tables of how well nodes of two frames are matched: errors of the matches (overall, by body region, by size of
the hole cut into the depth images), shares of matches within several distances of the truth, and times for matching.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Final

import numpy as np

from anchorpose.research.experiment.correspondence import REGIONS
from anchorpose.research.experiment.page.selection import (
    Matching,
    direct_mm,
    error_of,
    in_regions,
    mirrored_of,
    tree_mm,
)
from anchorpose.research.experiment.page.tables import (
    Column,
    Estimate,
    Row,
    Table,
    Unit,
    mean_over,
    median_over,
    ratio_of,
)
from anchorpose.research.experiment.page.tracking_tables import hole_column
from anchorpose.research.experiment.results import ExperimentResults, Matched, PaperTimes

CURVE_MM = tuple(range(0, 501, 20))
CURVE_SHARES = tuple(share / 200 for share in range(0, 61, 2))  # limits of a match's error, as shares of body height

NOTE = (
    "The same nodes for every method, of the paper’s scene. “Direct” is the nearest descriptor; a method with several "
    "hypotheses cannot choose one without the tree. A node without a match has no error: see the share matched."
)
ERROR_NOTE = "Direct matches; matches after the tree for methods without direct ones."

Take = Callable[[Matched], np.ndarray]


def matching_tables(results: ExperimentResults) -> list[Table]:
    """Return all tables of matches; an empty list if no matches were compared."""
    matching, resamples = Matching(results), results.config.resamples
    if not matching.windows:
        return []
    return [
        _overall(matching, resamples),
        _by_region(
            matching,
            resamples,
            "matching_by_region",
            "Median error of the matches by region, mm",
            median_over,
            Unit.MM,
            None,
        ),
        _by_region(
            matching,
            resamples,
            "mirrored_by_region",
            "Matches on the same part of the other side by region",
            mean_over,
            Unit.SHARE,
            mirrored_of,
        ),
        _by_size(matching, resamples, "matching_by_size", "Median error of the matches by size of hole, mm", None),
        _by_size(
            matching, resamples, "matching_by_size_tree", "Median error after the tree by size of hole, mm", tree_mm
        ),
        _curve(
            matching,
            resamples,
            "princeton_mm",
            "Share of nodes matched within a distance along the skin, mm",
            CURVE_MM,
            by_height=False,
        ),
        _curve(
            matching,
            resamples,
            "princeton_height",
            "Share of nodes matched within a share of the body’s height",
            CURVE_SHARES,
            by_height=True,
        ),
    ]


def _overall(matching: Matching, resamples: int) -> Table:
    def share(take: Take) -> Take:
        return lambda match: np.isfinite(take(match)).astype(float)

    columns: list[tuple[Column, Callable[..., Estimate], Take]] = []
    for name, take in (("direct", direct_mm), ("tree", tree_mm)):
        columns += [
            (Column(f"{name} mean", f"{name}, mean (mm)"), mean_over, take),
            (Column(f"{name} median", f"{name}, median (mm)"), median_over, take),
            (Column(f"{name} matched", f"{name}, matched", Unit.SHARE), mean_over, share(take)),
        ]
    columns.append((Column("mirrored", "on the other side’s limb", Unit.SHARE), mean_over, mirrored_of))
    rows = [
        Row(method, column, summarise(list(matching.values(method.key, take).values()), resamples))
        for method in matching.methods
        for column, summarise, take in columns
    ]
    note = f"{NOTE} {len(matching.windows)} pairs of frames."
    return Table("matching", "Error of the matches over all sizes of hole", "measure", note, tuple(rows))


def _by_region(
    matching: Matching,
    resamples: int,
    key: str,
    title: str,
    summarise: Callable[..., Estimate],
    unit: Unit,
    take: Take | None,
) -> Table:
    """Return a table by region of the body. take: function that returns a quantity of each node; None = the error of
    the node's match.
    """
    rows = []
    for method in matching.methods:
        of_method = take or error_of(matching, method.key)
        for index, region in enumerate(REGIONS):
            values = matching.values(method.key, in_regions(of_method, [index]))
            rows.append(Row(method, Column(region, region, unit), summarise(list(values.values()), resamples)))
    return Table(key, title, "region", f"{NOTE} {ERROR_NOTE}", tuple(rows))


def _by_size(matching: Matching, resamples: int, key: str, title: str, take: Take | None) -> Table:
    rows = []
    for method in matching.methods:
        of_method = take or error_of(matching, method.key)
        for hole in matching.holes():
            values = matching.values(method.key, of_method, hole)
            rows.append(Row(method, hole_column(hole), median_over(list(values.values()), resamples)))
    return Table(key, title, "hole_m", NOTE if take else f"{NOTE} {ERROR_NOTE}", tuple(rows))


def _curve(matching: Matching, resamples: int, key: str, title: str, places: Sequence[float], by_height: bool) -> Table:
    """Return a table of the share of nodes whose match is within each distance (``places``) of the truth.

    A node without a match is within no distance. by_height: distances are shares of the body's height, not mm.
    """
    rows = []
    for method in matching.methods:
        within = list(matching.values(method.key, partial(_counts, matching, np.array(places), by_height)).values())
        nodes = list(matching.values(method.key, lambda match: np.array([len(match.region)])).values())
        for number, x in enumerate(places):
            share = ratio_of([counts[:, number] for counts in within], nodes, resamples)
            rows.append(Row(method, Column(f"{x:g}", f"{x:g}", Unit.SHARE), share))
    note = f"{ERROR_NOTE} Shares of all nodes: a node without a match is within no distance."
    return Table(key, title, "within", note, tuple(rows))


def _counts(matching: Matching, places: np.ndarray, by_height: bool, match: Matched) -> np.ndarray:
    """Return, for each distance in ``places``, the number of nodes whose match is at most at this distance from the
    truth, along the skin: an array (1, places).
    """
    distance = match.direct_skin_mm if matching.has_direct(match.method) else match.tree_skin_mm
    known = np.sort(distance[np.isfinite(distance)])
    reach = places * 1000 * match.body_m if by_height else places
    return np.searchsorted(known, reach, side="right")[None, :]


PAPER_MESH_S: Final = 0.72
PAPER_FEATURE_S: Final = 0.23
PAPER_NODES: Final = 15549
PAPER_EDGES: Final = 36185
"""The size of the paper's mesh and the paper's times (s), from Section VI-B. The times are for one core of an Intel
i7-6700.
"""


def time_tables(results: ExperimentResults) -> list[Table]:
    """Return the table of each method's seconds for matching two frames; an empty list if no times were measured."""
    rows = _matching_rows(results)
    note = (
        "On one core, for the descriptors of one pair of frames and their matches, with the nodes of that mesh. The "
        "paper’s feature took 0.23 s on a mesh of 15,549 nodes."
    )
    return [Table("times", "Time, s", "what", note, tuple(rows))] if rows else []


def paper_time_lines(times: PaperTimes) -> list[tuple[str, str, str]]:
    """Return rows that compare the measured times with the paper's: step, value here, value in the paper."""
    return [
        ("image", times.image, "512 x 424"),
        ("nodes of the mesh", f"{times.nodes}", f"{PAPER_NODES}"),
        ("edges of the mesh", f"{times.edges}", f"{PAPER_EDGES}"),
        ("mesh", f"{times.mesh_s:.3g} s", f"{PAPER_MESH_S} s"),
        ("feature, five anchors, fast marching", f"{times.feature_s:.3g} s", "–"),
        ("feature, five anchors, Dijkstra", f"{times.dijkstra_s:.3g} s", f"{PAPER_FEATURE_S} s"),
    ]


def _matching_rows(results: ExperimentResults) -> list[Row]:
    matching, column = Matching(results), Column("describe", "descriptors and matches", Unit.SECONDS)
    return [
        Row(
            method,
            column,
            mean_over(
                list(matching.values(method.key, lambda match: np.array([match.describe_s])).values()),
                results.config.resamples,
            ),
        )
        for method in matching.methods
    ]
