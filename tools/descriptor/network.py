"""The network of the learnt descriptor: a small U-Net over whole depth images."""

from __future__ import annotations

import itertools
from typing import Final

import torch
from torch import nn
from torch.nn.functional import interpolate

WIDTHS: Final = (16, 32, 64, 112, 144)  # channels at a half, a quarter ... a thirty-second of the image
BLOCKS: Final = (0, 1, 1, 2, 2)  # residual blocks at each: most knowledge where pixels are few
FEATURES: Final = 32  # of a pixel, which all that is said of it is a linear function of
INPUTS: Final = 5


def _convolution(before: int, after: int, stride: int = 1) -> nn.Sequential:
    return nn.Sequential(
        nn.Conv2d(before, after, 3, stride, 1, bias=False), nn.BatchNorm2d(after), nn.ReLU(inplace=True)
    )


class Block(nn.Module):
    """Two convolutions beside the identity."""

    def __init__(self, width: int) -> None:
        super().__init__()
        self.first = _convolution(width, width)
        self.second = nn.Sequential(nn.Conv2d(width, width, 3, 1, 1, bias=False), nn.BatchNorm2d(width))

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        return torch.relu(x + self.second(self.first(x)))


class Network(nn.Module):
    """From (n, INPUTS, h, w) to (n, outputs, h/2, w/2); h and w are multiples of 32.

    Outputs of each second pixel: patches + 1 logits (the last: no person), the log of the error of the place, the vote
    for the pelvis (3), and FEATURES numbers from which ``places`` gives the offset within each patch.
    """

    def __init__(self, patches: int) -> None:
        super().__init__()
        self.patches = patches
        befores = (INPUTS, *WIDTHS[:-1])
        self.down = nn.ModuleList(
            nn.Sequential(_convolution(before, after, 2), *(Block(after) for _ in range(blocks)))
            for before, after, blocks in zip(befores, WIDTHS, BLOCKS, strict=True)
        )
        self.narrow = nn.ModuleList(
            nn.Sequential(nn.Conv2d(deep, shallow, 1, bias=False), nn.BatchNorm2d(shallow))
            for shallow, deep in itertools.pairwise(WIDTHS)
        )
        self.up = nn.ModuleList(
            _convolution(width, FEATURES) if level == 0 else Block(width) for level, width in enumerate(WIDTHS[:-1])
        )
        self.said = nn.Conv2d(FEATURES, patches + 5, 1)
        self.places = nn.Linear(FEATURES, 3 * patches)

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        levels = []
        for down in self.down:
            x = down(x)
            levels.append(x)
        for level in reversed(range(len(WIDTHS) - 1)):
            wide = interpolate(self.narrow[level](x), scale_factor=2.0, mode="nearest")
            x = self.up[level](torch.relu(levels[level] + wide))
        return torch.cat([self.said(x), x], dim=1)
