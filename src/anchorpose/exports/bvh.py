"""BVH: the skeleton as a hierarchy of rotating bones, for Blender and other animation programs."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import numpy as np

from anchorpose.errors import AnchorposeError
from anchorpose.exports.bvh_skeleton import Node, skeleton_of_joints, skeleton_of_poses
from anchorpose.exports.formats import ExportConfig, Product, Source, rounded_text, rows_text
from anchorpose.exports.opensim_coordinates import joint, rotations_deg
from anchorpose.exports.regular_time import RegularSamples, regular_samples, stretch_name, stretches_of
from anchorpose.results.poses import POSES_FILE

STEM: Final = "motion"
CM_PER_M: Final = 100.0
DIGITS: Final = 5
_PLACE, _TURN = "Xposition Yposition Zposition", "Zrotation Xrotation Yrotation"


def write_bvh(folder: Path, source: Source, config: ExportConfig) -> Product:
    """motion.bvh, or one file for each stretch without a gap; raises AnchorposeError where there is no such stretch."""
    regular = regular_samples(source.samples)
    from_poses = (source.folder / POSES_FILE).exists()
    nodes, root_m = _skeleton(source, regular, from_poses)
    known = np.stack([np.isfinite(node.axes).all(axis=(1, 2)) for node in nodes], axis=1)
    known &= np.isfinite(root_m).all(axis=1)[:, None]
    stretches = stretches_of(known)
    if not stretches.runs or not stretches.kept[0]:
        raise AnchorposeError("No two frames in a row have the joints that a BVH needs; export with --to csv instead.")
    kept = [place for place, keep in enumerate(stretches.kept) if keep]
    for number, (first, last) in enumerate(stretches.runs):
        text = bvh_text(nodes, kept, root_m[first:last], slice(first, last), regular.rate_hz)
        (folder / stretch_name(STEM, ".bvh", number, len(stretches.runs))).write_text(
            text, encoding="utf-8", newline="\n"
        )
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
            ("frames_left_out", len(regular.samples.time_s) - frames), ("rate_hz", regular.rate_hz),
        ),
        notes=(
            "Turns are those of the learnt body (poses.parquet)." if from_poses else
            "Turns are made from joint centres; a turn about a bone's own long axis is not in them.",
            *(f"{stretch_name(STEM, '.bvh', number, len(stretches.runs))} begins at "
              f"{float(regular.samples.time_s[first])!r} s." for number, (first, _) in enumerate(stretches.runs)),
            f"Left out for want of joints: {', '.join(left_out) or 'nothing'}.",
        ),
    )  # fmt: skip


def bvh_text(nodes: list[Node], kept: list[int], root_m: np.ndarray, rows: slice, rate_hz: float) -> str:
    """The file's text; kept: indices of the nodes to write, the root first; root_m (r, 3) of the ``rows``."""
    order, lines = _hierarchy(nodes, kept)
    columns = [root_m * CM_PER_M]
    for place in order:
        node = nodes[place]
        axes = node.axes[rows]
        if node.parent >= 0:
            axes = np.einsum("nji,njk->nik", nodes[node.parent].axes[rows], axes)
        columns.append(np.unwrap(np.stack(rotations_deg(axes), axis=1), period=360.0, axis=0))
    values = np.concatenate(columns, axis=1)
    head = ["HIERARCHY", *lines, "MOTION", f"Frames: {len(values)}", f"Frame Time: {1.0 / rate_hz:.9f}"]
    body = ([rounded_text(value, DIGITS, "") for value in row] for row in values.tolist())
    return rows_text(([line] for line in head), " ") + rows_text(body, " ")


def _skeleton(source: Source, regular: RegularSamples, from_poses: bool) -> tuple[list[Node], np.ndarray]:
    position_m = regular.samples.position_m
    if not from_poses:
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
