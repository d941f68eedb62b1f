"""BVH: the skeleton as a hierarchy of rotating bones, for Blender and other animation programs."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import numpy as np

from anchorpose.errors import AnchorposeError
from anchorpose.exports.bvh_skeleton import Node, skeleton_of_joints, skeleton_of_poses
from anchorpose.exports.formats import ExportConfig, Product, Source, rounded_text, write_rows
from anchorpose.exports.opensim_coordinates import joint, rotations_deg
from anchorpose.exports.regular_time import RegularSamples, regular_samples, stretch_name, stretches_of
from anchorpose.results.frame_time import blocks
from anchorpose.results.tables import POSES_FILE

STEM: Final = "motion"
CM_PER_M: Final = 100.0
DIGITS: Final = 5
_PLACE, _TURN = "Xposition Yposition Zposition", "Zrotation Xrotation Yrotation"


def write_bvh(folder: Path, source: Source, config: ExportConfig) -> Product:
    """motion.bvh, or one file for each stretch without a gap; raises AnchorposeError where there is no such stretch."""
    regular = regular_samples(source.samples)
    from_poses = (source.folder / POSES_FILE).exists()
    nodes, root_m = _skeleton(source, regular, from_poses)
    known = np.empty((len(root_m), len(nodes)), dtype=bool)
    for rows in blocks(len(root_m)):
        placed = np.isfinite(root_m[rows]).all(axis=1)
        for place, node in enumerate(nodes):
            known[rows, place] = np.isfinite(node.axes(rows)).all(axis=(1, 2)) & placed
    stretches = stretches_of(known)
    if not stretches.runs or not stretches.kept[0]:
        raise AnchorposeError("No two frames in a row have the joints that a BVH needs; export with --to csv instead.")
    kept = [place for place, keep in enumerate(stretches.kept) if keep]
    for number, (first, last) in enumerate(stretches.runs):
        path = folder / stretch_name(STEM, ".bvh", number, len(stretches.runs))
        write_bvh_file(path, nodes, kept, root_m, slice(first, last), regular.rate_hz)
    frames = sum(last - first for first, last in stretches.runs)
    left_out = [node.name for place, node in enumerate(nodes) if place not in kept]
    return Product(
        axes="Y up, the patient faces X, the patient's right is Z; the world of the recording",
        units="centimetres, degrees, turns about Z, then X, then Y",
        time=str(regular.base),
        missing="a BVH cannot hold a gap: bones known in less than half of the frames are left out, and each stretch "
        "of frames in which all the others are known is a file of its own",
        counts=(
            ("files", len(stretches.runs)), ("frames", frames),
            ("frames_left_out", len(regular.time_s) - frames), ("rate_hz", regular.rate_hz),
        ),
        notes=(
            "Turns are those of the learnt body (poses.parquet)." if from_poses else
            "Turns are made from joint centres; a turn about a bone's own long axis is not in them.",
            *(f"{stretch_name(STEM, '.bvh', number, len(stretches.runs))} begins at "
              f"{float(regular.time_s[first])!r} s." for number, (first, _) in enumerate(stretches.runs)),
            f"Left out for want of joints: {', '.join(left_out) or 'nothing'}.",
        ),
    )  # fmt: skip


def write_bvh_file(
    path: Path, nodes: list[Node], kept: list[int], root_m: np.ndarray, rows: slice, rate_hz: float
) -> None:
    """Writes the file of some ``rows``; kept: indices of the nodes to write, the root first; root_m (n, 3)."""
    order, lines = _hierarchy(nodes, kept)
    values = np.empty((rows.stop - rows.start, 3 + 3 * len(order)))
    values[:, :3] = root_m[rows] * CM_PER_M
    for number, place in enumerate(order, 1):
        values[:, 3 * number : 3 * number + 3] = _turns_deg(nodes, place, rows)
    head = ["HIERARCHY", *lines, "MOTION", f"Frames: {len(values)}", f"Frame Time: {1.0 / rate_hz:.9f}"]
    body = (
        [rounded_text(value, DIGITS, "") for value in row]
        for some in blocks(len(values))
        for row in values[some].tolist()
    )
    write_rows(path, " ", ([line] for line in head), body)


def _turns_deg(nodes: list[Node], place: int, rows: slice) -> np.ndarray:
    """(r, 3) about Z, X and Y, in the axes of the parent, without jumps by 360 degrees."""
    turns = np.empty((rows.stop - rows.start, 3))
    for some in blocks(len(turns)):
        chosen, node = slice(rows.start + some.start, rows.start + some.stop), nodes[place]
        axes = node.axes(chosen)
        if node.parent >= 0:
            axes = np.einsum("nji,njk->nik", nodes[node.parent].axes(chosen), axes)
        turns[some] = np.stack(rotations_deg(axes), axis=1)
    return np.unwrap(turns, period=360.0, axis=0)


def _skeleton(source: Source, regular: RegularSamples, from_poses: bool) -> tuple[list[Node], np.ndarray]:
    if not from_poses:
        position_m = regular.samples.position_m
        return skeleton_of_joints(position_m), joint(position_m, "SpineBase")
    return skeleton_of_poses(source.folder / POSES_FILE, source.samples, source.frame, regular.interpolation)


def _hierarchy(nodes: list[Node], kept: list[int]) -> tuple[list[int], list[str]]:
    """Indices of the nodes in the order of the file, parents before children, and the lines of the hierarchy."""
    order, lines = list[int](), list[str]()

    def visit(place: int, depth: int) -> None:
        node, indent = nodes[place], "\t" * depth
        children = [child for child in kept if nodes[child].parent == place]
        order.append(place)
        lines.append(f"{indent}{'ROOT' if depth == 0 else 'JOINT'} {node.name}")
        lines.append(f"{indent}{{")
        lines.append(f"{indent}\tOFFSET {_centimetres(node.offset_m)}")
        lines.append(f"{indent}\tCHANNELS {f'6 {_PLACE} {_TURN}' if depth == 0 else f'3 {_TURN}'}")
        for child in children:
            visit(child, depth + 1)
        if not children:
            lines.extend([f"{indent}\tEnd Site", f"{indent}\t{{", f"{indent}\t\tOFFSET {_centimetres(node.end_m)}",
                          f"{indent}\t}}"])  # fmt: skip
        lines.append(f"{indent}}}")

    visit(kept[0], 0)
    return order, lines


def _centimetres(vector_m: np.ndarray) -> str:
    return " ".join(rounded_text(float(value), DIGITS, "0") for value in vector_m * CM_PER_M)
