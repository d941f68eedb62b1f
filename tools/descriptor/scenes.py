"""Depth images of people in furnished rooms, with the place on the body of every pixel: thousands a second on a GPU."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final, NamedTuple

import torch
from people import POSTURES, People, Posed, Surface, surface_of
from sensors import sense

FOCAL_PX: Final = 200.0  # of every image that the network sees
HEIGHT, WIDTH = 192, 224
FARTHEST_M: Final = 9.0
NEAREST_M: Final = 0.3
MOST_PEOPLE: Final = 4
PEOPLE_SHARES: Final = (0.06, 0.40, 0.28, 0.16, 0.10)
SITS, LIES = POSTURES.index("sits"), POSTURES.index("lies")
ROOM: Final = 12  # loose boxes in a room
ROUND: Final = 8
CHAIRS: Final = 3
LOOKS: Final = 2  # a scene costs more than its image
CUT_OUT: Final = 0.1  # images that hold people alone: their background was removed


class Batch(NamedTuple):
    """Training images: depth_m (n, h, w) as sensed, 0 without a reading; of every second pixel (n, h/2, w/2):
    patch (the number of patches: no person; -1: not to be judged), place and vote (..., 3), person (-1 nobody); of each
    image (n,): which of ``sensors.KINDS`` the camera is, and whether the background was removed."""

    depth_m: torch.Tensor
    patch: torch.Tensor
    place: torch.Tensor
    vote_m: torch.Tensor
    person: torch.Tensor
    sensor: torch.Tensor
    cut_out: torch.Tensor


class Boxes(NamedTuple):
    """m boxes of each image: centre (n, m, 3), half sizes (n, m, 3), turns (n, m, 3, 3) box to world; 0 is absent."""

    centre: torch.Tensor
    half: torch.Tensor
    turn: torch.Tensor


@dataclass(frozen=True)
class View:
    """Cameras: turn (n, 3, 3) camera to world, X right, Y down, Z forward; place (n, 3)."""

    turn: torch.Tensor
    place: torch.Tensor


class Drawn(NamedTuple):
    """n scenes: true_m, person (-1 nobody) and face (n, h, w) as a camera without error sees them; skin_m of the people
    that are there, whose rows among all (n * MOST_PEOPLE) are ``kept``; where (n, MOST_PEOPLE, 3): their feet; boxes:
    what people sit on, lie on and stand in, loose furniture, and chairs; angular_m (n, h, w): without people and round
    things."""

    true_m: torch.Tensor
    person: torch.Tensor
    face: torch.Tensor
    skin_m: torch.Tensor
    kept: torch.Tensor
    posed: Posed
    where: torch.Tensor
    view: View
    boxes: tuple[Boxes, Boxes, Boxes]
    angular_m: torch.Tensor


class Scenes:
    """Draws batches of images."""

    def __init__(self, device: torch.device, seed: int) -> None:
        self.device = device
        self.generator = torch.Generator(device=device)
        self.generator.manual_seed(seed)
        self.people = People(device, self.generator)
        self.surface: Surface = surface_of(self.people.asset)
        self.face_place = torch.as_tensor(self.surface.places, device=device)
        self.face_patch = torch.as_tensor(self.surface.patch, device=device)
        columns = (torch.arange(WIDTH, device=device) - (WIDTH - 1) / 2.0) / FOCAL_PX
        rows = (torch.arange(HEIGHT, device=device) - (HEIGHT - 1) / 2.0) / FOCAL_PX
        y, x = torch.meshgrid(rows, columns, indexing="ij")
        self.rays = torch.stack([x, y, torch.ones_like(x)], dim=-1)
        self.box_depth, self.ball_depth = box_depth, ball_depth
        if device.type == "cuda":  # each in one pass over the pixels
            self.box_depth, self.ball_depth = torch.compile(box_depth), torch.compile(ball_depth)

    def draw(self, count: int) -> Batch:
        """``LOOKS`` images, by other sensors, of each of ``count`` scenes, with their answers."""
        drawn = self.scene(count)
        answers = [self.look(drawn) for _ in range(LOOKS)]
        return Batch(*(torch.cat(parts) for parts in zip(*answers, strict=True)))

    @torch.no_grad()
    def scene(self, count: int) -> Drawn:
        """``count`` scenes, each as its camera would see it without error."""
        people = self.people
        number = torch.multinomial(
            torch.tensor(PEOPLE_SHARES, device=self.device), count, replacement=True, generator=self.generator
        )
        there = torch.arange(MOST_PEOPLE, device=self.device) < number[:, None]
        kept = there.reshape(-1).nonzero()[:, 0]
        skin, posed = _spread(people.draw(len(kept)), kept, count * MOST_PEOPLE)
        view, where = self._place(count, posed)
        seats = self._seats(count, posed, where, there)
        clutter = self._clutter(count, posed, where)
        boxes = seats, clutter, self._chairs(count, where)
        angular_m = self._cast(view, _joined(*boxes))
        true_m = self._balls(view, angular_m, where)
        true_m, person, face = self._rasterise(view, skin, kept, where, true_m)
        return Drawn(true_m, person, face, skin, kept, posed, where, view, boxes, angular_m)

    @torch.no_grad()
    def look(self, drawn: Drawn) -> Batch:
        """An image of each scene, each by a sensor of its own, with the answers."""
        people = self.people
        depth_m, sensor = sense(drawn.true_m, people)
        cut_out = people.uniform(len(depth_m), 1, 1) < CUT_OUT
        depth_m = torch.where(cut_out & (drawn.person < 0), 0.0, depth_m)
        return self._answers(depth_m, drawn, sensor, cut_out[:, 0, 0])

    def pelvises(self, drawn: Drawn) -> torch.Tensor:
        """(n, MOST_PEOPLE, 3) of all people in the cameras' frames."""
        count, view = len(drawn.true_m), drawn.view
        base = drawn.posed.pelvis_m.reshape(count, MOST_PEOPLE, 3) + drawn.where - view.place[:, None]
        return base @ view.turn

    def _place(self, count: int, posed: Posed) -> tuple[View, torch.Tensor]:
        """Cameras, and where the people stand (n, MOST_PEOPLE, 3): the first in view, others near or anywhere."""
        p = self.people
        height = p.uniform(count, low=0.4, high=2.4)
        away = torch.exp(p.uniform(count, low=math.log(0.9), high=math.log(6.0)))
        aim = p.uniform(count, low=0.3, high=1.4)
        pitch = torch.atan2(height - aim, away) + p.normal(count, sigma=0.1)
        roll = p.normal(count, sigma=0.04)
        on_side = p.uniform(count)
        roll = roll + torch.where(on_side < 0.03, math.pi / 2, 0.0) - torch.where(on_side > 0.97, math.pi / 2, 0.0)
        forward = torch.stack([pitch.cos(), -pitch.sin(), torch.zeros_like(pitch)], dim=1)
        right = torch.tensor([0.0, 0.0, 1.0], device=self.device).expand(count, 3)
        down = torch.linalg.cross(forward, right)
        right, down = (
            roll.cos()[:, None] * right + roll.sin()[:, None] * down,
            roll.cos()[:, None] * down - roll.sin()[:, None] * right,
        )
        turn = torch.stack([right, down, forward], dim=2)
        place = torch.stack([torch.zeros_like(height), height, torch.zeros_like(height)], dim=1)
        where = torch.zeros(count, MOST_PEOPLE, 3, device=self.device)
        aside = p.uniform(count, low=-0.45, high=0.45) * away
        where[:, 0, 0], where[:, 0, 2] = away, aside
        for other in range(1, MOST_PEOPLE):
            far = torch.exp(p.uniform(count, low=math.log(1.0), high=math.log(6.0)))
            anywhere = torch.stack([far, torch.zeros_like(far), p.uniform(count, low=-0.55, high=0.55) * far], dim=1)
            round_ = p.uniform(count, low=0.0, high=2.0 * math.pi)
            near = p.uniform(count, low=0.22, high=0.7)
            beside = where[:, 0] + torch.stack([near * round_.cos(), torch.zeros_like(far), near * round_.sin()], 1)
            where[:, other] = torch.where((p.uniform(count) < 0.5)[:, None], beside, anywhere)
        posture = posed.posture.reshape(count, MOST_PEOPLE)
        lifted = torch.where(posture == LIES, p.uniform(count, MOST_PEOPLE, low=0.0, high=0.8), 0.0)
        lifted = lifted + (p.uniform(count, MOST_PEOPLE) < 0.08) * p.uniform(count, MOST_PEOPLE, high=0.4)
        where[:, :, 1] = lifted
        return View(turn, place), where

    def _upright(self, yaw: torch.Tensor) -> torch.Tensor:
        """Turns (..., 3, 3) about the vertical."""
        c, s, zero, one = yaw.cos(), yaw.sin(), torch.zeros_like(yaw), torch.ones_like(yaw)
        return torch.stack([c, zero, s, zero, one, zero, -s, zero, c], dim=-1).reshape(*yaw.shape, 3, 3)

    def _seats(self, count: int, posed: Posed, where: torch.Tensor, there: torch.Tensor) -> Boxes:
        """What people sit and lie on, and a frame of bars about the first; in axes of each person: X forward."""
        p, n = self.people, count * MOST_PEOPLE
        yaw = posed.facing
        pelvis = posed.pelvis_m[:, 1]
        exists = there.reshape(-1)
        sits = (posed.posture == SITS) & exists & (p.uniform(n) < 0.8)
        lies = (posed.posture == LIES) & exists & (p.uniform(n) < 0.8)
        zero = torch.zeros(n, device=self.device)
        top = (pelvis - p.uniform(n, low=0.07, high=0.13)).clamp_min(0.1)
        wide, thick = p.uniform(n, low=0.2, high=0.35), p.uniform(n, low=0.02, high=0.2)
        high = p.uniform(n, low=0.0, high=0.5)
        rest = p.uniform(n, low=0.08, high=0.14) + top
        arm = torch.where(p.uniform(n) < 0.5, 0.02, 0.0)
        parts = [  # centre and half size
            (torch.stack([zero - 0.02, top - thick, zero], 1), torch.stack([wide, thick, wide], 1), sits),
            (torch.stack([zero - 0.25, top + high, zero], 1), torch.stack([zero + 0.03, high, wide], 1), sits),
            (torch.stack([zero, rest, wide], 1), torch.stack([wide * 0.8, zero + 0.03, arm], 1), sits & (arm > 0)),
            (torch.stack([zero, rest, -wide], 1), torch.stack([wide * 0.8, zero + 0.03, arm], 1), sits & (arm > 0)),
            (torch.stack([zero, top * 0.4, zero], 1), torch.stack([wide * 0.7, top * 0.4, wide * 0.7], 1), sits),
            (
                torch.stack([zero, zero - 0.2, zero], 1),
                torch.stack([p.uniform(n, low=0.9, high=1.2), zero + 0.2, p.uniform(n, low=0.35, high=0.9)], 1),
                lies,
            ),
        ]
        centre = torch.stack([c for c, _, _ in parts], 1)
        half = torch.stack([h * keep[:, None] for _, h, keep in parts], 1)
        turn = self._upright(yaw)
        base = where.reshape(n, 3)
        own = torch.einsum("nij,nmj->nmi", turn, centre) + base[:, None]
        turns = turn[:, None].expand(-1, len(parts), -1, -1)
        seats = Boxes(*(t.reshape(count, -1, *t.shape[2:]) for t in (own, half, turns)))
        return _joined(seats, self._frame(count, yaw.reshape(count, -1)[:, 0], where[:, 0]))

    def _frame(self, count: int, yaw: torch.Tensor, where: torch.Tensor) -> Boxes:
        """Bars, posts, pads and a tray about the first person, each there or not."""
        p = self.people
        thick = p.uniform(count, low=0.01, high=0.03)
        zero = torch.zeros(count, device=self.device)
        beside, before = p.uniform(count, low=0.28, high=0.5), p.uniform(count, low=0.2, high=0.5)
        rail, long = p.uniform(count, low=0.6, high=1.15), p.uniform(count, low=0.3, high=1.4)
        pad, behind = p.uniform(count, low=0.35, high=0.6), p.uniform(count, low=0.2, high=0.5)
        rows = [
            ((zero, rail, beside), (long, thick, thick)),
            ((zero, rail, -beside), (long, thick, thick)),
            ((before, rail * 0.5, beside), (thick, rail * 0.5, thick)),
            ((before, rail * 0.5, -beside), (thick, rail * 0.5, thick)),
            ((-behind, rail * 0.5, beside), (thick, rail * 0.5, thick)),
            ((-behind, rail * 0.5, -beside), (thick, rail * 0.5, thick)),
            ((before * 0.5 + 0.05, pad, zero), (thick + 0.02, thick + 0.05, beside)),
            ((before, rail, zero), (thick + 0.03, thick, beside)),
            ((before + 0.15, rail + 0.02, zero), (zero + 0.2, thick, beside)),
        ]
        centre = torch.stack([torch.stack(c, 1) for c, _ in rows], 1)
        half = torch.stack([torch.stack(h, 1) for _, h in rows], 1)
        there = (p.uniform(count, 1) < 0.4) & (p.uniform(count, len(rows)) < 0.7)
        turn = self._upright(yaw)
        own = (
            torch.einsum("nij,nmj->nmi", turn, centre)
            + (where * torch.tensor([1.0, 0.0, 1.0], device=self.device))[:, None]
        )
        return Boxes(own, half * there[:, :, None], turn[:, None].expand(-1, len(rows), -1, -1))

    def _clutter(self, count: int, posed: Posed, where: torch.Tensor) -> Boxes:
        """Furniture of any size, table tops, screens, poles, things that hang, and things close to the camera."""
        p = self.people
        far = p.uniform(count, ROOM, low=0.8, high=6.0)
        behind = where[:, :1, 0] + p.uniform(count, ROOM, low=0.2, high=3.0)
        far = torch.where(p.uniform(count, ROOM) < 0.65, behind, far)
        centre = torch.stack([far, torch.zeros_like(far), p.uniform(count, ROOM, low=-0.8, high=0.8) * far], dim=2)
        half = torch.exp(p.uniform(count, ROOM, 3, low=math.log(0.02), high=math.log(0.8)))
        kind = p.uniform(count, ROOM)
        flat = kind < 0.2  # table tops and shelves
        thin = (kind > 0.2) & (kind < 0.4)  # screens, walls, doors
        pole = (kind > 0.4) & (kind < 0.5)
        half[..., 1] = torch.where(flat, 0.02, half[..., 1])
        half[..., 0] = torch.where(thin | pole, 0.025, half[..., 0])
        half[..., 2] = torch.where(pole, 0.025, half[..., 2])
        half[..., 1] = torch.where(pole, p.uniform(count, ROOM, low=0.4, high=1.1), half[..., 1])
        raised = torch.where(flat | (p.uniform(count, ROOM) < 0.25), p.uniform(count, ROOM, high=1.2), 0.0)
        centre[..., 1] = half[..., 1] + raised
        number = p.uniform(count, 1) * ROOM
        there = torch.arange(ROOM, device=self.device) < number
        close = (torch.arange(ROOM, device=self.device) == 0) & (p.uniform(count, 1) < 0.12)
        near = torch.stack(
            [
                p.uniform(count, low=0.45, high=1.2),
                p.uniform(count, low=0.2, high=1.8),
                p.uniform(count, low=-0.5, high=0.5),
            ],
            dim=1,
        )
        centre = torch.where(close[..., None], near[:, None], centre)
        half = torch.where(close[..., None], half.clamp_max(0.25), half)
        # nothing stands in the first person
        apart = (centre - where[:, :1])[..., [0, 2]].norm(dim=2) > half[..., [0, 2]].norm(dim=2) + 0.15
        turn = self._upright(p.uniform(count, ROOM, low=-math.pi, high=math.pi))
        return Boxes(centre, half * ((there | close) & apart)[..., None], turn)

    def _chairs(self, count: int, where: torch.Tensor) -> Boxes:
        """Chairs, stools and tables with legs, of nobody."""
        p, n = self.people, count * CHAIRS
        zero = torch.zeros(n, device=self.device)
        top, wide = p.uniform(n, low=0.3, high=0.8), p.uniform(n, low=0.15, high=0.35)
        deep = wide * p.uniform(n, low=0.8, high=1.6)
        leg, thick = p.uniform(n, low=0.01, high=0.03), p.uniform(n, low=0.01, high=0.06)
        back = p.uniform(n, low=0.1, high=0.35)
        rows = [
            ((zero, top, zero), (wide, thick, deep)),
            ((-wide, top + back, zero), (leg, back * (p.uniform(n) < 0.7), deep)),
            *(
                ((wide * i * 0.9, top * 0.5, deep * j * 0.9), (leg, top * 0.5, leg))
                for i, j in ((1, 1), (1, -1), (-1, 1), (-1, -1))
            ),
        ]
        centre = torch.stack([torch.stack(c, 1) for c, _ in rows], 1)
        half = torch.stack([torch.stack(h, 1) for _, h in rows], 1)
        far = p.uniform(n, low=1.0, high=5.5)
        base = torch.stack([far, zero, p.uniform(n, low=-0.7, high=0.7) * far], 1)
        apart = (base.reshape(count, CHAIRS, 3) - where[:, :1]).norm(dim=2).reshape(n) > 0.6
        there = (p.uniform(n) < 0.4) & apart
        turn = self._upright(p.uniform(n, low=-math.pi, high=math.pi))
        own = torch.einsum("nij,nmj->nmi", turn, centre) + base[:, None]
        whole = Boxes(own, half * there[:, None, None], turn[:, None].expand(-1, len(rows), -1, -1))
        return Boxes(*(part.reshape(count, -1, *part.shape[2:]) for part in whole))

    def _cast(self, view: View, boxes: Boxes) -> torch.Tensor:
        """(n, h, w) depth of walls, floor and boxes."""
        p, count = self.people, len(view.turn)
        inside = torch.stack(
            [
                p.uniform(count, low=2.5, high=8.0),
                p.uniform(count, low=1.2, high=1.9),
                p.uniform(count, low=1.2, high=5.0),
            ],
            1,
        )
        middle = torch.stack(
            [inside[:, 0] * p.uniform(count, low=0.3, high=0.9), inside[:, 1], p.normal(count, sigma=0.5)], 1
        )
        turn = self._upright(p.normal(count, sigma=0.4))
        depth = room_depth(self.rays, view.turn, view.place, middle, inside, turn)
        open_ = (p.uniform(count) < 0.12)[:, None, None]
        depth = torch.where(open_, FARTHEST_M, depth)
        boxes = packed(boxes)
        for box in range(boxes.centre.shape[1]):
            depth = self.box_depth(
                depth, self.rays, view.turn, view.place, boxes.centre[:, box], boxes.half[:, box], boxes.turn[:, box]
            )
        return depth

    def _balls(self, view: View, depth: torch.Tensor, where: torch.Tensor) -> torch.Tensor:
        """Round things: alone, or joined to a body that is nobody's."""
        p, count = self.people, len(depth)
        far = p.uniform(count, low=1.0, high=5.0)
        base = torch.stack([far, p.uniform(count, low=0.2, high=1.2), p.uniform(count, low=-0.5, high=0.5) * far], 1)
        joined = (p.uniform(count, 1) < 0.25).expand(count, ROUND)
        lone = p.uniform(count, ROUND) < 0.15
        centre = base[:, None] + p.normal(count, ROUND, 3) * torch.where(joined, 0.3, 1.0)[..., None]
        radius = torch.exp(p.uniform(count, ROUND, 3, low=math.log(0.04), high=math.log(0.4)))
        even = p.uniform(count, ROUND, 1) < 0.4
        radius = torch.where(even, radius[..., :1].expand_as(radius), radius)
        apart = (centre[..., None, :] - where[:, None, :1])[..., [0, 2]].norm(dim=-1)[..., 0] > radius.amax(-1) + 0.25
        radius = radius * ((joined | lone) & apart)[..., None]
        turn = self._upright(p.uniform(count, ROUND, low=-math.pi, high=math.pi))
        for ball in range(ROUND):
            depth = self.ball_depth(
                depth, self.rays, view.turn, view.place, centre[:, ball], radius[:, ball], turn[:, ball]
            )
        return depth

    def _rasterise(
        self, view: View, skin: torch.Tensor, kept: torch.Tensor, where: torch.Tensor, depth: torch.Tensor
    ) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
        """Depth with the people before the room; who (-1 nobody) and which face is seen, (n, h, w)."""
        image = kept // MOST_PEOPLE
        skin = skin + where.reshape(-1, 3)[kept][:, None] - view.place[image][:, None]
        skin = skin @ view.turn[image]
        buffer = (depth * 1e4).long().reshape(-1) << FACE_BITS + PERSON_BITS
        buffer |= (1 << FACE_BITS + PERSON_BITS) - 1
        for part in torch.arange(len(kept), device=self.device).split(256):
            self._draw(skin[part], image[part], kept[part] % MOST_PEOPLE, buffer)
        lower = buffer & ((1 << FACE_BITS + PERSON_BITS) - 1)
        nobody = lower == (1 << FACE_BITS + PERSON_BITS) - 1
        person = torch.where(nobody, -1, lower >> FACE_BITS).reshape(depth.shape)
        face = torch.where(nobody, 0, lower & ((1 << FACE_BITS) - 1)).reshape(depth.shape)
        nearest = (buffer >> FACE_BITS + PERSON_BITS).float().reshape(depth.shape) * 1e-4
        return nearest, person, face

    def _draw(self, skin: torch.Tensor, image: torch.Tensor, person: torch.Tensor, buffer: torch.Tensor) -> None:
        """Depth buffer over all triangles at once: each gives as many candidates as its box has pixel centres."""
        z = skin[..., 2]
        x = skin[..., 0] / z.clamp_min(1e-3) * FOCAL_PX + (WIDTH - 1) / 2.0
        y = skin[..., 1] / z.clamp_min(1e-3) * FOCAL_PX + (HEIGHT - 1) / 2.0
        faces = self.people.faces
        xs, ys, zs = x[:, faces], y[:, faces], z[:, faces]  # (n, f, 3)
        area = (xs[..., 1] - xs[..., 0]) * (ys[..., 2] - ys[..., 0]) - (xs[..., 2] - xs[..., 0]) * (
            ys[..., 1] - ys[..., 0]
        )
        left, right = xs.amin(-1).ceil().clamp_min(0), xs.amax(-1).floor().clamp_max(WIDTH - 1)
        top, bottom = ys.amin(-1).ceil().clamp_min(0), ys.amax(-1).floor().clamp_max(HEIGHT - 1)
        wide, high = (right - left + 1).clamp_min(0).long(), (bottom - top + 1).clamp_min(0).long()
        shown = (zs.amin(-1) > 0.15) & (area.abs() > 1e-9)
        number = wide * high * shown
        some = number.nonzero()
        n, f = some[:, 0], some[:, 1]
        times = number[n, f]
        which = torch.repeat_interleave(torch.arange(len(n), device=self.device), times)
        first = torch.cumsum(times, 0) - times
        within = torch.arange(len(which), device=self.device) - first[which]
        n, f = n[which], f[which]
        across = wide[n, f]
        px, py = left[n, f] + within % across, top[n, f] + within // across
        x0, x1, x2 = xs[n, f].unbind(-1)
        y0, y1, y2 = ys[n, f].unbind(-1)
        z0, z1, z2 = zs[n, f].unbind(-1)
        size = area[n, f]
        w1 = ((px - x0) * (y2 - y0) - (x2 - x0) * (py - y0)) / size
        w2 = ((x1 - x0) * (py - y0) - (px - x0) * (y1 - y0)) / size
        w0 = 1.0 - w1 - w2
        inside = (w0 >= 0) & (w1 >= 0) & (w2 >= 0)
        depth = 1.0 / (w0 / z0 + w1 / z1 + w2 / z2)
        pixel = (image[n] * HEIGHT + py.long()) * WIDTH + px.long()
        key = ((depth * 1e4).long() << FACE_BITS + PERSON_BITS) | (person[n] << FACE_BITS) | f
        buffer.scatter_reduce_(0, pixel[inside], key[inside], "amin")

    def _answers(self, depth: torch.Tensor, drawn: Drawn, sensor: torch.Tensor, cut_out: torch.Tensor) -> Batch:
        half = (slice(None), slice(None, None, 2), slice(None, None, 2))
        person, face, sensed, true = drawn.person[half], drawn.face[half], depth[half], drawn.true_m[half]
        nobody = len(self.surface.centres)
        patch = torch.where(person >= 0, self.face_patch[face], nobody)
        patch = torch.where((sensed <= 0) | ((sensed - true).abs() > 0.06 + 0.02 * true), -1, patch)
        place = self.face_place[face]
        base = self.pelvises(drawn)
        points = self.rays[::2, ::2] * true[..., None]
        own = torch.gather(base, 1, person.clamp_min(0).reshape(len(depth), -1, 1).expand(-1, -1, 3)).reshape(
            points.shape
        )
        return Batch(depth, patch, place, own - points, person, sensor, cut_out)


FACE_BITS, PERSON_BITS = 15, 3


def _joined(*several: Boxes) -> Boxes:
    return Boxes(*(torch.cat(parts, dim=1) for parts in zip(*several, strict=True)))


def packed(boxes: Boxes) -> Boxes:
    """The boxes that are there, first; as many for each image as the fullest has."""
    there = boxes.half[..., 1] > 0
    order = torch.argsort((~there).byte(), dim=1, stable=True)[:, : int(there.sum(dim=1).max())]
    rows = torch.arange(len(order), device=order.device)[:, None]
    return Boxes(*(part[rows, order] for part in boxes))


def _spread(posed: Posed, kept: torch.Tensor, count: int) -> tuple[torch.Tensor, Posed]:
    """The skins of the people that are there, and all else with rows for those who are not."""
    rest = []
    for values in posed[1:]:
        rows = torch.zeros(count, *values.shape[1:], dtype=values.dtype, device=values.device)
        rows[kept] = values
        rest.append(rows)
    return posed.skin_m, Posed(posed.skin_m[:0], *rest)


def _in_box(
    rays: torch.Tensor, turn: torch.Tensor, place: torch.Tensor, centre: torch.Tensor, own: torch.Tensor
) -> tuple[torch.Tensor, torch.Tensor]:
    """Rays and origins in a box's axes: (n, h, w, 3) and (n, 1, 1, 3)."""
    back = own.transpose(1, 2)
    seen = (back @ turn)[:, None, None]
    direction = rays[..., :1] * seen[..., 0] + rays[..., 1:2] * seen[..., 1] + seen[..., 2]
    origin = torch.einsum("nij,nj->ni", back, place - centre)
    return direction, origin[:, None, None]


def room_depth(
    rays: torch.Tensor,
    turn: torch.Tensor,
    place: torch.Tensor,
    centre: torch.Tensor,
    half: torch.Tensor,
    own: torch.Tensor,
) -> torch.Tensor:
    """Depth to the inside of a box; ``FARTHEST_M`` at most."""
    direction, origin = _in_box(rays, turn, place, centre, own)
    safe = torch.where(direction.abs() < 1e-6, 1e-6, direction)
    out = (torch.sign(safe) * half[:, None, None] - origin) / safe
    return torch.where(out > 0, out, FARTHEST_M).amin(dim=-1).clamp(NEAREST_M, FARTHEST_M)


def box_depth(
    depth: torch.Tensor,
    rays: torch.Tensor,
    turn: torch.Tensor,
    place: torch.Tensor,
    centre: torch.Tensor,
    half: torch.Tensor,
    own: torch.Tensor,
) -> torch.Tensor:
    """``depth`` with a box before it; a box of no size is absent."""
    direction, origin = _in_box(rays, turn, place, centre, own)
    safe = torch.where(direction.abs() < 1e-6, 1e-6, direction)
    one, two = (-half[:, None, None] - origin) / safe, (half[:, None, None] - origin) / safe
    near, far = torch.minimum(one, two).amax(dim=-1), torch.maximum(one, two).amin(dim=-1)
    hit = (near < far) & (near > NEAREST_M) & (half[:, 1] > 0)[:, None, None]
    return torch.where(hit & (near < depth), near, depth)


def ball_depth(
    depth: torch.Tensor,
    rays: torch.Tensor,
    turn: torch.Tensor,
    place: torch.Tensor,
    centre: torch.Tensor,
    radius: torch.Tensor,
    own: torch.Tensor,
) -> torch.Tensor:
    """``depth`` with an ellipsoid before it; without a radius it is absent."""
    direction, origin = _in_box(rays, turn, place, centre, own)
    size = radius.clamp_min(1e-4)[:, None, None]
    d, o = direction / size, origin / size
    a, b, c = (d * d).sum(-1), (d * o).sum(-1), (o * o).sum(-1) - 1.0
    root = b * b - a * c
    near = (-b - root.clamp_min(0).sqrt()) / a
    hit = (root > 0) & (near > NEAREST_M) & (radius[:, 0] > 0)[:, None, None]
    return torch.where(hit & (near < depth), near, depth)
