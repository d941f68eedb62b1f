"""Train the learnt descriptor on simulated depth images: ``python tools/train_descriptor.py STATE --images 4e6``.

Needs PyTorch, which users never need (``pip install torch onnx``). Images are drawn as they are needed, and no scene
is seen twice. A run that was stopped goes on from STATE. The rate of learning falls with the share of the images that
were seen. ``--export FILE.weights`` writes the network with its weights as halves. ``--card`` prints what the package's
weights say of people of every kind (``descriptor/card.py``).
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import time
from pathlib import Path
from typing import Final, NamedTuple

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE / "descriptor"), str(HERE.parent / "src")]

import torch  # noqa: E402
from export import export, stored_state  # noqa: E402
from network import FEATURES, Network  # noqa: E402
from people import surface_of  # noqa: E402
from scenes import Batch, Scenes  # noqa: E402
from torch.nn.functional import avg_pool2d, cross_entropy  # noqa: E402

from anchorpose.body.asset import stored_asset  # noqa: E402

RATE: Final = 2e-3
WARM_UP: Final = 0.01  # of all images
CHECK_SEED: Final = 990_000
STATURE_M: Final = 1.71  # of the mean adult: what errors are given in
SIDE: Final = 0.02  # of stature off the middle: there left and right differ


def inputs_of(depth_m: torch.Tensor) -> torch.Tensor:
    """(n, 5, h, w) of depth (n, h, w): range, whether there is a reading, relief against two means, nearness."""
    seen = (depth_m > 0).to(depth_m.dtype)
    layers = [depth_m / 4.0, seen]
    for size, most in ((9, 0.15), (33, 0.5)):
        share = avg_pool2d(seen[:, None], size, 1, size // 2)[:, 0]
        mean = avg_pool2d(depth_m[:, None], size, 1, size // 2)[:, 0] / share.clamp_min(1e-6)
        layers.append(((depth_m - mean) / most).clamp(-1.0, 1.0) * seen)
    layers.append(seen / depth_m.clamp_min(0.3))
    return torch.stack(layers, dim=1)


class Losses(NamedTuple):
    """What is minimised, and what is told."""

    total: torch.Tensor
    nobody: torch.Tensor
    patch: torch.Tensor
    place: torch.Tensor
    vote: torch.Tensor
    spread: torch.Tensor


def places_of(network: Network, features: torch.Tensor, patch: torch.Tensor, centres: torch.Tensor) -> torch.Tensor:
    """(m, 3) places of pixels with features (m, FEATURES), within the given patches (m,)."""
    weight = network.places.weight.reshape(network.patches, 3, FEATURES)[patch].float()
    offset = torch.einsum("mij,mj->mi", weight, features) + network.places.bias.reshape(-1, 3)[patch].float()
    return centres[patch] + 0.1 * offset


def losses_of(network: Network, fast: torch.nn.Module, batch: Batch, centres: torch.Tensor) -> Losses:
    """Classes of patches over judged pixels; place, error and vote over those of people."""
    with torch.autocast(batch.depth_m.device.type, torch.bfloat16, enabled=batch.depth_m.is_cuda):
        out = fast(inputs_of(batch.depth_m).contiguous(memory_format=torch.channels_last))
    out = out.float().permute(0, 2, 3, 1)
    p = network.patches
    empty = out[batch.patch == p][:, : p + 1]
    mine = (batch.patch >= 0) & (batch.patch < p)
    body, patch, place = out[mine], batch.patch[mine], batch.place[mine]
    nobody = cross_entropy(empty, torch.full((len(empty),), p, device=empty.device))
    # half of the weight is spread evenly over the body, so that hands count as much as the trunk
    often = torch.bincount(patch, minlength=p).clamp_min(1).float()
    weight = 0.5 + 0.5 * len(patch) / p / often[patch]
    classes = (weight * cross_entropy(body[:, : p + 1], patch, reduction="none")).mean()
    features = body[:, p + 5 :]
    within = (places_of(network, features, patch, centres) - place).abs().sum(dim=1)
    offset = (weight * within).mean()
    with torch.no_grad():
        error = (places_of(network, features, body[:, :p].argmax(dim=1), centres) - place).norm(dim=1)
    log = body[:, p + 1].clamp(-7.0, 2.0)
    spread = (error / log.exp() + log).mean()
    vote = (body[:, p + 2 : p + 5] - batch.vote_m[mine]).abs().sum(dim=1).mean()
    total = 2.0 * nobody + classes + 10.0 * offset + vote + 0.1 * spread
    return Losses(total, nobody, classes, offset, vote, spread)


@torch.no_grad()
def check(network: Network, batches: list[Batch], centres: torch.Tensor) -> dict[str, float]:
    """Figures on images that no training saw."""
    network.eval()
    errors, sides, hit, found, wrong, votes, ratio = [], [], [], [], [], [], []
    for batch in batches:
        out = network(inputs_of(batch.depth_m)).permute(0, 2, 3, 1)
        p = network.patches
        person = out[..., : p + 1].softmax(dim=-1)[..., p] < 0.5
        mine = (batch.patch >= 0) & (batch.patch < p)
        found.append(person[mine])
        wrong.append(person[batch.patch == p])
        body, place = out[mine], batch.place[mine]
        guess = places_of(network, body[:, p + 5 :], body[:, :p].argmax(dim=1), centres)
        errors.append((guess - place).norm(dim=1) * STATURE_M)
        ratio.append(errors[-1] / STATURE_M / body[:, p + 1].exp())
        aside = (place[:, 2].abs() > SIDE) & (guess[:, 2].abs() > SIDE)
        sides.append((guess[:, 2] * place[:, 2] < 0)[aside])
        hit.append(body[:, :p].argmax(dim=1) == batch.patch[mine])
        votes.append((body[:, p + 2 : p + 5] - batch.vote_m[mine]).norm(dim=1))
    network.train()
    error = torch.cat(errors)
    return {
        "median_cm": 100.0 * float(error.median()),
        "p75_cm": 100.0 * float(error.sort().values[int(0.75 * len(error))]),
        "p90_cm": 100.0 * float(error.sort().values[int(0.9 * len(error))]),
        "sides": float(torch.cat(sides).float().mean()),
        "patch": float(torch.cat(hit).float().mean()),
        "found": float(torch.cat(found).float().mean()),
        "wrong": float(torch.cat(wrong).float().mean()),
        "vote_cm": 100.0 * float(torch.cat(votes).median()),
        "error_over_told": float(torch.cat(ratio).mean()),
    }


def rate_at(share: float) -> float:
    """Rate of learning after a share of all images."""
    return RATE * min(1.0, share / WARM_UP) * 0.5 * (1.0 + math.cos(math.pi * min(share, 1.0)))


def train(
    state: Path, images: float, size: int, minutes: float, seed: int, device: torch.device, start_from: Path | None
) -> None:
    """Train until all images or the time are used; the state is written every two minutes."""
    began = saved = time.monotonic()
    checks = Scenes(device, CHECK_SEED)
    batches = [checks.draw(64) for _ in range(4)]
    centres = torch.as_tensor(checks.surface.centres, device=device)
    network = Network(len(centres)).to(device, memory_format=torch.channels_last)
    optimizer = torch.optim.AdamW(network.parameters(), lr=RATE, weight_decay=0.01)
    mean = {name: value.clone().float() for name, value in network.state_dict().items()}
    seen, curve = 0, []
    fast = torch.compile(network) if device.type == "cuda" else network
    if state.exists():
        stored = torch.load(state, map_location=device, weights_only=True)
        network.load_state_dict(stored["network"])
        optimizer.load_state_dict(stored["optimizer"])
        mean, seen, curve = stored["mean"], stored["seen"], stored["curve"]
    elif start_from is not None:
        begun, seen = stored_state(start_from)
        network.load_state_dict(begun)
        mean = {name: value.clone().float() for name, value in network.state_dict().items()}
    scenes = Scenes(device, seed + seen)
    told = seen - 100_000 if seen and not curve else seen  # what is gone on from is checked first
    while seen < images and time.monotonic() - began < 60.0 * minutes:
        batch = scenes.draw(size)
        for group in optimizer.param_groups:
            group["lr"] = rate_at(seen / images)
        losses = losses_of(network, fast, batch, centres)
        optimizer.zero_grad(set_to_none=True)
        losses.total.backward()
        torch.nn.utils.clip_grad_norm_(network.parameters(), 1.0)
        optimizer.step()
        seen += len(batch.depth_m)
        keep = min(0.999, 1.0 - 1.0 / (10.0 + seen / len(batch.depth_m)))
        with torch.no_grad():
            for name, value in network.state_dict().items():
                mean[name].lerp_(value.float(), 1.0 - keep)
        last = seen >= images or time.monotonic() - began >= 60.0 * minutes
        if seen - told >= 100_000 or last or (seen - told >= 10_000 and seen < 100_000):
            told = seen
            judged = Network(len(centres)).to(device)
            judged.load_state_dict(mean)
            figures = {"images": seen, "seconds": time.monotonic() - began} | check(judged, batches, centres)
            figures |= {name: float(value.detach()) for name, value in losses._asdict().items()}
            curve.append(figures)
            print(json.dumps({name: round(value, 4) for name, value in figures.items()}), flush=True)
        if last or time.monotonic() - saved > 120.0:
            saved = time.monotonic()
            whole = {"network": network.state_dict(), "optimizer": optimizer.state_dict()}
            beside = state.with_suffix(".new")
            torch.save(whole | {"mean": mean, "seen": seen, "curve": curve}, beside)
            beside.replace(state)


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("state", type=Path, nargs="?", help="where the training is kept, which goes on from there")
    parser.add_argument("--images", type=float, help="to train on, 4e6, or of the card, 500")
    parser.add_argument("--batch", type=int, default=256, help="scenes a step, each looked at twice")
    parser.add_argument("--minutes", type=float, default=math.inf)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--start-from", type=Path, help="weights to go on from where there is no STATE yet")
    parser.add_argument("--export", type=Path, help="write the trained network there, and train no further")
    parser.add_argument("--card", action="store_true", help="print the model card of the package's weights, and stop")
    parser.add_argument("--device", default="cuda" if torch.cuda.is_available() else "cpu")
    options = parser.parse_args()
    if options.card:
        from card import IMAGES, measure
        from card_tables import card

        print(card(measure(int(options.images or IMAGES))))
        return
    if options.state is None:
        parser.error("name STATE, or give --card")
    if options.export is not None:
        stored = torch.load(options.state, map_location="cpu", weights_only=True)
        centres = torch.as_tensor(surface_of(stored_asset()).centres)
        network = Network(len(centres))
        network.load_state_dict(stored["mean"])
        export(network, centres, stored["seen"], options.export)
        return
    train(
        options.state,
        options.images or 4e6,
        options.batch,
        options.minutes,
        options.seed,
        torch.device(options.device),
        options.start_from,
    )


if __name__ == "__main__":
    main()
