"""How well a smoothed pose, which neither pass had, explains the depth images of its frame."""

from __future__ import annotations

from anchorpose.body.evidence import gather_evidence
from anchorpose.body.explained import Explanation, explain
from anchorpose.body.skin_points import Body, pose_points
from anchorpose.isolation.scene import find_all_pieces
from anchorpose.isolation.separation import view_of
from anchorpose.isolation.view import View
from anchorpose.recording.recording import FrameSet
from anchorpose.results.people_labels import LabelImage, decode_labels
from anchorpose.surface.patient_surface import blank_view, patient_surface
from anchorpose.surface.surface import seen_part
from anchorpose.tracker.room import Room
from anchorpose.tracker.run import Run
from anchorpose.tracker.smoothing import PassResult


def explain_smoothed(frame_set: FrameSet, answer: PassResult, body: Body, run: Run) -> Explanation | None:
    """The explanation by the pose of both passes together; None where there is none.

    frame_set: the frame, read again; to keep the views of all frames until both passes have met would fill the memory.
    Person labels are those of ``answer``.
    """
    if answer.pose is None:
        return None
    cameras = run.room.cameras
    views = labelled_views(frame_set, answer.labels, run.room)
    shown = [blank_view(camera) if view is None else view for view, camera in zip(views, cameras, strict=True)]
    surface = seen_part(patient_surface(shown, cameras, None, run.config.surface))
    return explain(body.points, pose_points(body, answer.pose), gather_evidence(surface, views, cameras))


def labelled_views(frame_set: FrameSet, images: tuple[LabelImage, ...], room: Room) -> tuple[View | None, ...]:
    """One view per camera as it was when ``images`` were encoded; None for a camera without a depth image."""
    labels = {image.camera: decode_labels(image) for image in images}
    return tuple(
        None
        if pixels is None or camera.name not in labels
        else view_of(pixels, labels[camera.name][pixels.row, pixels.column])
        for camera, pixels in zip(room.cameras, find_all_pieces(frame_set, room.scenes), strict=True)
    )
