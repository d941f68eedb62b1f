"""What depth cameras make of a true depth image, many at once: noise, edges, steps, losses, smoothing."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

import torch
from torch.nn.functional import avg_pool2d, interpolate, max_pool2d

if TYPE_CHECKING:
    from people import People

KINDS: Final = ("white noise", "stereo", "smoothed", "smeared")
"""Of sensors: every pixel by itself; blobs, steps and shadows; a maker's filters; these at their strongest."""


def sense(true_m: torch.Tensor, draw: People) -> tuple[torch.Tensor, torch.Tensor]:
    """(n, h, w) readings, 0 where there is none; (n,) which of ``KINDS`` the camera is. Each image has its own.

    Axial noise grows with the square of range (Fankhauser et al. 2015, doi:10.1109/ICAR.2015.7251485); a stereo
    camera's comes in blobs and steps of disparity, and its maker's filters smooth across edges.
    """
    count, height, width = true_m.shape
    stereo = (draw.uniform(count) < 0.5)[:, None, None]
    smoothed = (draw.uniform(count) < 0.25)[:, None, None]
    jittered = _jitter(true_m, draw)
    depth, edge = _edges(torch.where(stereo, _fattened(jittered, draw), jittered), draw)
    gain = torch.exp(draw.uniform(count, low=math.log(0.3), high=math.log(3.0)))[:, None, None]
    white, blobs = draw.normal(count, height, width), _blobs(draw, count, height, width, 3)
    noise = torch.where(stereo, blobs * 1.5, white)
    depth = depth + noise * gain * (0.0008 + 0.0012 * depth**2)
    depth = depth + _blobs(draw, count, height, width, 48) * draw.uniform(count, high=0.008)[:, None, None]
    step = torch.where(stereo[:, 0, 0], draw.uniform(count) ** 2 * 0.004, 0.0)[:, None, None]  # of disparity, 1 / m
    depth = torch.where(
        step > 1e-4, 1.0 / (torch.round(1.0 / depth / step.clamp_min(1e-4)) * step.clamp_min(1e-4)), depth
    )
    depth = torch.where(smoothed, _smoothed(depth, draw), depth)
    filled = (draw.uniform(count) < 0.18)[:, None, None]  # a maker's filters at their strongest: no holes, no edges
    depth = torch.where(filled, _smeared(depth, draw), depth)
    lost = draw.uniform(count, height, width) < draw.uniform(count, high=0.01)[:, None, None]
    lost |= edge & (draw.uniform(count, height, width) < draw.uniform(count, high=0.5)[:, None, None])
    blind = draw.uniform(count)[:, None, None] < 0.35
    threshold = (0.2 + 2.4 * draw.uniform(count) ** 0.4)[:, None, None]
    lost |= blind & (_blobs(draw, count, height, width, 10) > threshold)
    lost |= _shadow(depth, draw) & stereo
    lost &= ~filled
    far = torch.where(draw.uniform(count) < 0.6, draw.uniform(count, low=3.5, high=6.0), 8.5)[:, None, None]
    near = draw.uniform(count, low=0.3, high=0.6)[:, None, None]
    lost |= ~((depth > near) & (depth < far))
    lost |= _border(draw, count, height, width)
    kind = torch.where(filled, 3, torch.where(smoothed, 2, stereo.long()))
    return torch.where(lost, 0.0, depth), kind[:, 0, 0]


def _blobs(draw: People, count: int, height: int, width: int, size: int) -> torch.Tensor:
    """Smooth noise of standard deviation of about 1, ``size`` pixels wide."""
    coarse = draw.normal(count, 1, height // size + 3, width // size + 3)
    wide = interpolate(coarse, scale_factor=float(size), mode="bilinear", align_corners=False)[:, 0]
    return wide[:, :height, :width] * 1.4


def _jitter(true_m: torch.Tensor, draw: People) -> torch.Tensor:
    """At edges a pixel may look a pixel aside."""
    count, height, width = true_m.shape
    aside = torch.randint(-1, 2, (2, count, height, width), device=draw.device, generator=draw.generator)
    aside = aside * (draw.uniform(count, height, width) < 0.35)
    rows = (torch.arange(height, device=draw.device)[:, None] + aside[0]).clamp(0, height - 1)
    columns = (torch.arange(width, device=draw.device) + aside[1]).clamp(0, width - 1)
    moved = torch.gather(true_m.reshape(count, -1), 1, (rows * width + columns).reshape(count, -1)).reshape(
        true_m.shape
    )
    return torch.where((moved - true_m).abs() > 0.05, moved, true_m)


def _edges(depth: torch.Tensor, draw: People) -> tuple[torch.Tensor, torch.Tensor]:
    """Flying pixels, and which pixels lie at an edge."""
    far = max_pool2d(depth[:, None], 3, 1, 1)[:, 0]
    near = -max_pool2d(-depth[:, None], 3, 1, 1)[:, 0]
    edge = far - near > 0.05 + 0.03 * depth
    count, height, width = depth.shape
    flying = edge & (draw.uniform(count, height, width) < draw.uniform(count, high=0.3)[:, None, None])
    return torch.where(flying, near + draw.uniform(count, height, width) * (far - near), depth), edge


def _fattened(depth: torch.Tensor, draw: People) -> torch.Tensor:
    """What is near grows by a pixel, in blobs: blocks of pixels are matched, and the nearer surface has the texture."""
    near = -max_pool2d(-depth[:, None], 3, 1, 1)[:, 0]
    grown = _blobs(draw, *depth.shape, 6) > draw.uniform(len(depth), low=-1.0, high=4.0)[:, None, None]
    return torch.where(grown & (depth - near > 0.05), near, depth)


def _smoothed(depth: torch.Tensor, draw: People) -> torch.Tensor:
    """A maker's filters: means over 3 and 7 pixels, at edges too."""
    small = avg_pool2d(depth[:, None], 3, 1, 1, count_include_pad=False)[:, 0]
    large = avg_pool2d(small[:, None], 5, 1, 2, count_include_pad=False)[:, 0]
    share = draw.uniform(len(depth))[:, None, None]
    return torch.where(share < 0.4, small, torch.where(share < 0.7, large, 0.5 * (small + large)))


def _smeared(depth: torch.Tensor, draw: People) -> torch.Tensor:
    """Depth as spatial and temporal filters at half the resolution leave it: smooth over 4 to 12 pixels."""
    count, height, width = depth.shape
    small = avg_pool2d(depth[:, None], 4, 4)
    blobs = (
        _blobs(draw, count, height // 4, width // 4, 4)[:, None] * draw.uniform(count, high=0.02)[:, None, None, None]
    )
    small = small + blobs * small**2
    once = avg_pool2d(small, 3, 1, 1, count_include_pad=False)
    share = draw.uniform(count)[:, None, None, None]
    small = torch.where(share < 0.5, small, once)
    return interpolate(small, size=(height, width), mode="bilinear", align_corners=False)[:, 0]


def _shadow(depth: torch.Tensor, draw: People) -> torch.Tensor:
    """What the second imager of a stereo camera does not see: beside an edge, as wide as its step in disparity."""
    disparity = 1.0 / depth.clamp_min(0.3)
    wide = draw.uniform(len(depth), high=12.0)[:, None, None]  # baseline times focal length: pixels at one metre
    hidden = torch.zeros_like(depth, dtype=torch.bool)
    for shift in range(1, 9):
        nearer = torch.roll(disparity, shift, dims=2) - disparity
        nearer[..., :shift] = 0.0
        hidden |= nearer * wide > shift
    return hidden


def _border(draw: People, count: int, height: int, width: int) -> torch.Tensor:
    """A frame without readings: images are of other sizes than the canvas."""
    cut = (draw.uniform(count, 4) ** 3 * 0.45) * (draw.uniform(count, 4) < 0.2)
    rows = (torch.arange(height, device=draw.device) / height)[None, :, None]
    columns = (torch.arange(width, device=draw.device) / width)[None, None]
    cut = cut[:, :, None, None]
    return (rows < cut[:, 0]) | (rows > 1 - cut[:, 1]) | (columns < cut[:, 2]) | (columns > 1 - cut[:, 3])
