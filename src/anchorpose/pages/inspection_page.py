"""Write the page of one inspected frame, with pictures, a sentence, and the meaning of the colours for each stage."""

from __future__ import annotations

import base64
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from anchorpose.isolation.view import PixelLabel
from anchorpose.joints import ANCHOR_NAMES, JOINT_NAMES
from anchorpose.pages import inspection_drawing
from anchorpose.pages.canvas import Ink, as_hex, as_png
from anchorpose.pages.stage_drawing import draw_depth
from anchorpose.recording.reader import open_recording
from anchorpose.recording.recording_file import with_height
from anchorpose.report.words import render_page
from anchorpose.results.folder import FolderKind, write_text_whole
from anchorpose.threads import one_thread
from anchorpose.tracker.config import TrackConfig
from anchorpose.tracker.inspection import InspectedCamera, Inspection, inspect_frame

PAGE_FILE: Final = "index.html"
FACTS_FILE: Final = "inspect.json"
"""Name of the file that has the content of the page as numbers."""

INSPECTION: Final = FolderKind("an inspection", (FACTS_FILE, PAGE_FILE), (FACTS_FILE, PAGE_FILE, "*/*.png"))


@dataclass(frozen=True, slots=True, kw_only=True)
class Section:
    """A stage as the page shows it, with its caption and its pictures: the bytes of a PNG file by camera name."""

    stage: Stage
    caption: str
    pictures: Mapping[str, bytes]

    @property
    def legend(self) -> list[tuple[str, str]]:
        """Return (colour as web pages write it, meaning) for each colour of the pictures."""
        return [(as_hex(colour), meaning) for colour, meaning in self.stage.legend]

    @property
    def embedded(self) -> dict[str, str]:
        """Return the pictures by camera name, in the form (base64) in which the page embeds them."""
        return {camera: base64.b64encode(png).decode("ascii") for camera, png in self.pictures.items()}


def write_inspection(
    folder: Path, title: str, sections: Sequence[Section], account: Sequence[str], facts: dict[str, Any]
) -> Path:
    """Write each camera's pictures, inspect.json and index.html into an existing folder; return the page's path.

    The pictures are ``<camera>/<number>_<stage>.png`` in the order of the stages; the page embeds them all.
    """
    for number, section in enumerate(sections, 1):
        for camera, png in section.pictures.items():
            (folder / camera).mkdir(exist_ok=True)
            (folder / camera / f"{number:02d}_{section.stage.key}.png").write_bytes(png)
    (folder / FACTS_FILE).write_text(json.dumps(facts, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
    page = render_page("anchorpose.pages", "inspection_page.html", title=title, account=account, sections=sections)
    write_text_whole(folder / PAGE_FILE, page)
    return folder / PAGE_FILE


@dataclass(frozen=True, slots=True, kw_only=True)
class Stage:
    """The description of a stage. draw: function that draws one camera's picture, or returns None if nothing is to be
    drawn. caption: a text with the placeholders ``{next_frame}`` (the next frame's number) and ``{rooms}`` (the source
    of each camera's empty room). legend: (colour, meaning) of each colour. missing: the text if no camera has a
    picture.
    """

    key: str
    title: str
    caption: str
    draw: Callable[[InspectedCamera], np.ndarray | None]
    legend: tuple[tuple[Sequence[float], str], ...] = ()
    missing: str = "No camera has a usable picture of this frame."


NO_SURFACE: Final = "No surface of the patient was found in this frame, so there is nothing to show."
NO_NEXT: Final = "The patient is not followed into a next frame, so there is nothing to link this one with."
NO_POSE: Final = "The patient was not found in this frame: the sentences at the top say why."
NO_EQUIPMENT: Final = (
    "The recording has no equipment.json, so no equipment is known; 'anchorpose equipment fit' proposes one."
)

STAGES: Final = (
    Stage(
        key="depth",
        title="What the camera recorded",
        draw=lambda one: draw_depth(one.depth_m, one.camera),
        caption="Distance from the camera: yellow is near, blue is far, black has no reading.",
    ),
    Stage(
        key="background",
        title="The empty room",
        draw=lambda one: draw_depth(one.scene.background.depth_m, one.camera),
        caption="What the camera sees when nobody is there ({rooms}).",
    ),
    Stage(
        key="standing_out",
        title="The foreground",
        draw=inspection_drawing.draw_foreground,
        caption="Pixels that are nearer than the empty room by more than the sensor's noise.",
        legend=((Ink.SKY, "nearer than the room"),),
    ),
    Stage(
        key="equipment",
        title="The equipment",
        draw=inspection_drawing.draw_equipment,
        missing=NO_EQUIPMENT,
        caption="Pixels on the equipment are removed; the tracker keeps a record of what the equipment may hide.",
        legend=(
            (Ink.WHITE, "outline: where the equipment is expected"),
            (Ink.EQUIPMENT, "removed as equipment"),
            (Ink.BLUE, "striped: the equipment hides what is behind"),
        ),
    ),
    Stage(
        key="people",
        title="People",
        draw=inspection_drawing.draw_people,
        caption="Each person has a colour; only the patient is tracked.",
        legend=(
            (Ink.PATIENT, "the patient"),
            *((colour, f"person {number}") for number, colour in enumerate(Ink.OTHERS, 2)),
            (Ink.EQUIPMENT, "equipment"),
            (Ink.GREY, "nobody: flying pixels, small components, or people not separated"),
        ),
    ),
    Stage(
        key="surface",
        title="The patient's surface",
        draw=inspection_drawing.draw_mesh,
        missing=NO_SURFACE,
        caption="A mesh over the visible skin, lit from the upper left.",
        legend=(
            (inspection_drawing.SEEN_ONCE, "seen by this camera"),
            (inspection_drawing.SEEN_TWICE, "and linked with another camera's surface"),
            (Ink.YELLOW, "edges over a small gap"),
            (Ink.GREEN, "hidden skin: inferred from where the patient is expected"),
            (Ink.PURPLE, "ends behind another part of the patient's body"),
            (Ink.VERMILLION, "cut off by equipment, a person, a hole or the picture's edge"),
        ),
    ),
    Stage(
        key="geodesics",
        title="Distance along the skin",
        draw=inspection_drawing.draw_geodesics,
        missing=NO_SURFACE,
        caption="Distance of each point from the centre along the skin; a line every 10 cm, grey is not reached.",
    ),
    Stage(
        key="anchors",
        title="Anchors: head, hands and feet",
        draw=inspection_drawing.draw_anchors,
        missing=NO_SURFACE,
        caption="The points farthest from the centre; each of the five anchors is found or reported as missed.",
        legend=(
            (Ink.WHITE, "ring: an end of the surface"),
            (Ink.VERMILLION, "identified as the part named beside it"),
            (Ink.SKY, "found in another camera's picture"),
        ),
    ),
    Stage(
        key="hypotheses",
        title="Hypotheses",
        draw=inspection_drawing.draw_hypotheses,
        missing=NO_NEXT,
        caption="How many hypotheses found each point again in frame {next_frame}; grey points were not found at all.",
    ),
    Stage(
        key="tree",
        title="The best chain of hypotheses",
        draw=inspection_drawing.draw_tree,
        missing=NO_NEXT,
        caption="Where the skin moves from this frame to frame {next_frame} according to the frames after it; the "
        f"arrows are {inspection_drawing.MAGNIFIED:g} times as long as the movement.",
        legend=((Ink.SKY, "matched"), (Ink.ORANGE, "cross: no match that agrees with the movement so far")),
    ),
    Stage(
        key="registration",
        title="The body and its joints",
        draw=inspection_drawing.draw_registration,
        missing=NO_POSE,
        caption="The body fitted to the picture: a filled joint was seen, a hollow one is inferred, a cross is hidden "
        "by an unknown cause; the circle around a joint is two standard deviations.",
        legend=((Ink.YELLOW, "outline of the body, circles of uncertainty"), (Ink.WHITE, "joints and limbs")),
    ),
)


def inspection_sections(inspection: Inspection, config: TrackConfig) -> tuple[Section, ...]:
    """Return the sections of the page in their order, with a picture from each camera that has a depth image."""
    cameras = [
        InspectedCamera(inspection, number, depth, config)
        for number, depth in enumerate(inspection.frame_set.depths_m)
        if depth is not None
    ]
    following = inspection.next
    next_frame = following.observation.frame_set.frame if following is not None else "the next"
    rooms = "; ".join(f"camera {s.camera.name}: {s.background.source.value}" for s in inspection.room.scenes)
    sections = []
    for stage in STAGES:
        drawn = {one.camera.name: stage.draw(one) for one in cameras}
        pictures = {name: as_png(picture) for name, picture in drawn.items() if picture is not None}
        caption = stage.caption.format(next_frame=next_frame, rooms=rooms)
        sections.append(Section(stage=stage, caption=caption, pictures=pictures))
    return tuple(sections)


def inspection_facts(inspection: Inspection) -> dict[str, Any]:
    """Return the content of inspect.json, such as the number of pixels of each label, the anchors found and the
    joints.
    """
    facts: dict[str, Any] = {
        "recording": inspection.room.recording.folder.resolve().name,
        "frame": inspection.frame_set.frame,
        "time_s": inspection.frame_set.time_s,
        "problems": list(inspection.frame_set.problems),
        "account": list(inspection.account),
    }
    seen, following, estimate = inspection.observation, inspection.next, inspection.estimate
    if seen is not None:
        cameras = zip(inspection.room.cameras, seen.evidence.views, strict=True)
        facts["pixels"] = {camera.name: _pixel_counts(view.labels) for camera, view in cameras if view is not None}
        facts["nodes"] = len(seen.surface)
        facts["anchors_found"] = [name for name, found in zip(ANCHOR_NAMES, seen.anchors.found, strict=True) if found]
    if following is not None:
        matched = np.isfinite(following.hypothesis.matched_m).all(axis=1)
        facts["next_frame"] = following.observation.frame_set.frame
        facts["tree_nodes"], facts["tree_matched"] = len(matched), int(matched.sum())
    if estimate is not None:
        joints = zip(JOINT_NAMES, estimate.states, estimate.joints_m, estimate.sigma_m, strict=True)
        facts["explained_share"] = round(estimate.explained, 4)
        facts["joints"] = [
            {"joint": name, "state": str(state), "position_m": _rounded(position), "sigma_m": _rounded(sigma[None])}
            for name, state, position, sigma in joints
        ]
    return facts


def _pixel_counts(labels: np.ndarray) -> dict[str, int]:
    counts = np.bincount(labels.ravel())
    names = {int(label): label.name.lower() for label in PixelLabel}
    return {names.get(label, f"person_{label}"): int(count) for label, count in enumerate(counts) if count}


def _rounded(values: np.ndarray) -> list[float | None]:
    return [None if np.isnan(value) else round(float(value), 5) for value in values]


def inspect_recording(
    recording: Path, out: Path, frame: int, config: TrackConfig, as_tracked: bool, tick: Callable[[], None]
) -> Inspection:
    """Write the page and pictures of one frame into the existing, empty folder ``out``. as_tracked: whether the body is
    learnt and the patient followed from the initial frame, as by ``track``, and not from a nearby frame (see
    ``inspect_frame``). tick: function that is called for every frame that is read.
    """
    with one_thread():
        opened = open_recording(recording)
        inspection = inspect_frame(with_height(opened, config.height_m), frame, config, as_tracked, tick)
        title = f"{recording.resolve().name}: frame {frame}, {inspection.frame_set.time_s:.2f} s"
        account = (*opened.notes, *inspection.account, *inspection.frame_set.problems)
        write_inspection(out, title, inspection_sections(inspection, config), account, inspection_facts(inspection))
    return inspection
