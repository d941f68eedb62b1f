"""Everybody in a frame with a rough body: where the pelvis is, which way they face, and that none explains two."""

from __future__ import annotations

import numpy as np
import pytest
from body_builder import adult_body, photograph, skin_in, standing, stepped
from room_builder import FRONT, ROOM, built_scene, camera_at, picture

from anchorpose.recording.recording import FrameSet
from anchorpose.tracker import sighting as stage
from anchorpose.tracker.config import TrackConfig
from anchorpose.tracker.sighting import sight_people

SIDE = camera_at((1.2, 1.3, -2.2), (0.0, 0.9, 0.0))
SCENES = [built_scene(camera=camera) for camera in (FRONT, SIDE)]
CONFIG = TrackConfig()


def seen(*poses):
    """The sighting of naked adults in these poses, in a room with a wall and a floor."""
    depths = []
    for camera in (FRONT, SIDE):
        depth = picture(camera, *ROOM, seed=5)
        for pose in poses:
            person = photograph(skin_in(pose, adult_body()), camera).depth_m
            depth = np.where((person > 0) & (person < depth), person, depth)
        depths.append(depth)
    return sight_people(FrameSet(frame=0, time_s=0.0, depths_m=tuple(depths)), SCENES, CONFIG)


def turned(angle_deg: float, x: float, z: float):
    return stepped(standing(Hips=(0.0, angle_deg, 0.0)), x, 0.0, z)


def test_each_has_a_body_where_it_stands_and_faces_where_it_faces():
    found = seen(turned(0.0, 0.0, 0.6), turned(90.0, 0.1, -0.6))
    people = sorted(found.people, key=lambda one: -one.place_xz_m[1])
    assert len(people) == 2
    for person, place, facing in zip(people, [(0.0, 0.6), (0.1, -0.6)], [(1.0, 0.0), (0.0, -1.0)], strict=True):
        assert person.body.explained > 0.9
        assert person.place_xz_m == pytest.approx(place, abs=0.08)
        assert person.body.facing_xz @ facing > 0.9


def test_somebody_alone_costs_no_body(monkeypatch):
    monkeypatch.setattr(stage, "rough_body", lambda *_: pytest.fail("a body was fitted"))
    (person,) = seen(turned(0.0, 0.0, 0.0)).people
    assert person.body is None
    assert person.place_xz_m == pytest.approx((0.0, 0.0), abs=0.2)


def test_nobody_is_nobody():
    assert seen().people == ()
