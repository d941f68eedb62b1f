"""An inspected frame as sections of a page: each stage's pictures, its one sentence and what its colours mean."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace
from typing import Any, Final

import numpy as np

from anchorpose.geodesics.anchors import ANCHOR_NAMES
from anchorpose.isolation.view import PixelLabel
from anchorpose.joints import JOINT_NAMES
from anchorpose.pages.canvas import as_png
from anchorpose.pages.inspection_page import Section, StagePicture
from anchorpose.pages.inspection_surface import (
    MAGNIFIED,
    SEEN_ONCE,
    SEEN_TWICE,
    draw_anchors,
    draw_background,
    draw_equipment,
    draw_foreground,
    draw_geodesics,
    draw_hypotheses,
    draw_mesh,
    draw_people,
    draw_reading,
    draw_registration,
    draw_tree,
)
from anchorpose.pages.palette import (
    BLUE,
    EQUIPMENT,
    GREEN,
    GREY,
    ORANGE,
    OTHERS,
    PATIENT,
    PURPLE,
    SKY,
    VERMILLION,
    WHITE,
    YELLOW,
    as_hex,
)
from anchorpose.tracker.config import TrackConfig
from anchorpose.tracker.inspection import InspectedCamera, Inspection
from anchorpose.tracker.observation import Observation

Drawing = Callable[[InspectedCamera], np.ndarray | None]
SurfaceDrawing = Callable[[InspectedCamera, Observation, np.ndarray], np.ndarray | None]

NO_SURFACE: Final = "No surface of the patient was found in this frame, so there is nothing to show."
NO_NEXT: Final = "There is no next frame in which he is followed, so there is nothing to link this one with."
NO_POSE: Final = "The patient was not found in this frame: the sentences at the top say why."
NO_EQUIPMENT: Final = (
    "The recording has no equipment.json, so nothing is known to be equipment; 'anchorpose equipment fit' proposes one."
)


def inspection_sections(inspection: Inspection, config: TrackConfig) -> tuple[Section, ...]:
    """The stages in their order, with a picture for each camera that has one of this frame."""
    cameras = [
        InspectedCamera(inspection, number, depth, config)
        for number, depth in enumerate(inspection.frame_set.depths_m)
        if depth is not None
    ]
    return tuple(_with_pictures(section, draw, missing, cameras) for section, draw, missing in _stages(inspection))


def inspection_facts(inspection: Inspection) -> dict[str, Any]:
    """The same in numbers, for inspect.json: pixels of each kind, nodes, anchors, matches, joints."""
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
        facts["explained_share"] = round(estimate.explained, 4)
        facts["joints"] = [
            {"joint": name, "state": str(state), "position_m": _rounded(position), "sigma_m": _rounded(sigma[None])}
            for name, state, position, sigma in zip(
                JOINT_NAMES, estimate.states, estimate.joints_m, estimate.sigma_m, strict=True
            )
        ]
    return facts


def _stages(inspection: Inspection) -> Iterable[tuple[Section, Drawing, str]]:
    """Every stage with how it is drawn, and why it is missing where no camera has a picture of it."""
    following = inspection.next
    number = following.observation.frame_set.frame if following is not None else "the next"
    yield (
        Section(
            key="depth",
            title="What the camera recorded",
            caption="Distance from the camera: yellow is near, blue is far, black has no reading.",
        ),
        draw_reading,
        "",
    )
    yield (
        Section(
            key="background",
            title="The empty room",
            caption=f"What the camera sees when nobody is there ({_sources(inspection)}).",
        ),
        draw_background,
        "",
    )
    yield (
        Section(
            key="standing_out",
            title="What stands out of the room",
            caption="Pixels that are nearer than the empty room by more than the sensor's noise.",
            legend=_legend((SKY, "nearer than the room")),
        ),
        draw_foreground,
        "",
    )
    yield (
        Section(
            key="equipment",
            title="The equipment",
            caption="Pixels on the equipment are taken away, and it is remembered what they may hide.",
            legend=_legend(
                (WHITE, "outline: where the equipment is expected"),
                (EQUIPMENT, "removed as equipment"),
                (BLUE, "striped: the equipment hides what is behind"),
            ),
        ),
        draw_equipment,
        NO_EQUIPMENT,
    )
    yield (
        Section(
            key="people",
            title="People",
            caption="Everybody has a colour of his own; only the patient is tracked.",
            legend=_legend(
                (PATIENT, "the patient"),
                *((colour, f"person {number}") for number, colour in enumerate(OTHERS, 2)),
                (EQUIPMENT, "equipment"),
                (GREY, "nobody: flying pixels, crumbs, or not told apart"),
            ),
        ),
        draw_people,
        "",
    )
    yield from _surface_stages(number)
    yield (
        Section(
            key="registration",
            title="The body and its joints",
            caption=(
                "The body laid into the picture: a filled joint was seen, a hollow one is inferred, a cross is "
                "hidden by what is not known; the circle around a joint is two standard deviations."
            ),
            legend=_legend((YELLOW, "outline of the body, circles of uncertainty"), (WHITE, "joints and limbs")),
        ),
        draw_registration,
        NO_POSE,
    )


def _surface_stages(number: int | str) -> Iterable[tuple[Section, Drawing, str]]:
    yield (
        Section(
            key="surface",
            title="The patient's surface",
            caption="A mesh over the visible skin, lit from the upper left.",
            legend=_legend(
                (SEEN_ONCE, "seen by this camera"),
                (SEEN_TWICE, "and linked with another camera's surface"),
                (YELLOW, "edges over a small gap"),
                (GREEN, "hidden skin: inferred from where he is expected"),
                (PURPLE, "ends behind another part of himself"),
                (VERMILLION, "cut off by equipment, a person, a hole or the picture's edge"),
            ),
        ),
        _of_surface(draw_mesh),
        NO_SURFACE,
    )
    yield (
        Section(
            key="geodesics",
            title="Distance along the skin",
            caption="How far each spot is from the centre along the skin; a line every 10 cm, grey is not reached.",
        ),
        _of_surface(draw_geodesics),
        NO_SURFACE,
    )
    yield Section(
        key="anchors",
        title="Anchors: head, hands and feet",
        caption="Spots farthest from the centre; each of the five is found, or said to be missed.",
        legend=_legend(
            (WHITE, "ring: an end of the surface"), (VERMILLION, "taken for the part beside it"),
            (SKY, "found in another camera's picture"),
        ),
    ), _of_surface(draw_anchors), NO_SURFACE  # fmt: skip
    yield (
        Section(
            key="hypotheses",
            title="Hypotheses",
            caption=f"In how many ways each spot was found again in frame {number}; grey spots were not found at all.",
        ),
        _of_surface(draw_hypotheses),
        NO_NEXT,
    )
    yield (
        Section(
            key="tree",
            title="The best chain of hypotheses",
            caption=(
                f"Where the skin goes from this frame to frame {number} according to the frames after it; the arrows "
                f"are {MAGNIFIED:g} times as long as the movement."
            ),
            legend=_legend((SKY, "matched"), (ORANGE, "cross: no match that agrees with the movement so far")),
        ),
        _of_surface(draw_tree),
        NO_NEXT,
    )


def _with_pictures(section: Section, draw: Drawing, missing: str, cameras: Iterable[InspectedCamera]) -> Section:
    drawn = [(one.camera.name, draw(one)) for one in cameras]
    pictures = tuple(StagePicture(name, as_png(picture)) for name, picture in drawn if picture is not None)
    return replace(section, pictures=pictures) if pictures else replace(section, missing=missing or NO_PICTURE)


NO_PICTURE: Final = "No camera has a picture of this frame that can be used."


def _of_surface(draw: SurfaceDrawing) -> Drawing:
    """A drawing of the nodes that one camera saw; None where it saw none."""

    def drawn(one: InspectedCamera) -> np.ndarray | None:
        seen = one.inspection.observation
        if seen is None:
            return None
        own = seen.surface.camera == one.number
        return draw(one, seen, own) if own.any() else None

    return drawn


def _sources(inspection: Inspection) -> str:
    return "; ".join(f"camera {scene.camera.name}: {scene.background.source.value}" for scene in inspection.room.scenes)


def _legend(*entries: tuple[Any, str]) -> tuple[tuple[str, str], ...]:
    return tuple((as_hex((int(b), int(g), int(r))), text) for (b, g, r), text in entries)


def _pixel_counts(labels: np.ndarray) -> dict[str, int]:
    counts = np.bincount(labels.ravel())
    names = {int(label): label.name.lower() for label in PixelLabel}
    return {names.get(label, f"person_{label}"): int(count) for label, count in enumerate(counts) if count}


def _rounded(values: np.ndarray) -> list[float | None]:
    return [None if np.isnan(value) else round(float(value), 5) for value in values]
