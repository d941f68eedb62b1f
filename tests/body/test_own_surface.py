"""Nodes matched to the body's own surface, and limbs along the paths of anchors, without any prediction."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from body_builder import (
    BODY_CAMERAS,
    adult_body,
    joint_errors_m,
    joints_of,
    points,
    seen_body,
    seen_geodesics,
    standing,
    stepped,
    turned_about_y,
)

from anchorpose.body.anchor_limbs import anchor_paths, anchor_poses
from anchorpose.body.initial import anchor_points
from anchorpose.body.limb_proposals import CHAINS, exchanged
from anchorpose.body.own_poses import neutral, poses_of_own_surface, settle_on
from anchorpose.body.own_surface import MIRRORED, PAIRS, match_skin, own_surface, skin_distance, turns
from anchorpose.body.pose import Pose
from anchorpose.body.skin_points import pose_points
from anchorpose.geodesics.anchors import ANCHOR_NAMES, no_anchors
from anchorpose.geodesics.extrema import Cap
from anchorpose.geodesics.seen import SeenGeodesics
from anchorpose.joints import JOINT_INDEX
