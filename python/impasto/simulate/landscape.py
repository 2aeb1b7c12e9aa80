"""The scene of a simulated painting: a landscape under a low sun."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from impasto.simulate.fields import Field, blur, fractal, smoothstep

SKY, CLOUD, HILL, FIELD, WATER, TREE, HOUSE, GRASS = range(8)
LONGEST = 360
"""Longer side of the landscape in cells: finer than the positions of strokes."""

MOODS: tuple[dict[str, tuple[float, float, float]], ...] = (
    {  # late summer afternoon
        "zenith": (0.16, 0.36, 0.68), "sky": (0.44, 0.66, 0.84), "horizon": (0.99, 0.86, 0.60),
        "light": (1.00, 0.95, 0.78), "shade": (0.52, 0.55, 0.72), "sun": (1.00, 0.97, 0.80),
        "hill": (0.42, 0.48, 0.68), "field": (0.80, 0.68, 0.26), "meadow": (0.40, 0.53, 0.20),
        "dark": (0.10, 0.17, 0.15), "leaf": (0.34, 0.46, 0.14), "flower": (0.84, 0.20, 0.14),
    },
    {  # evening, the sun in the haze
        "zenith": (0.16, 0.24, 0.52), "sky": (0.70, 0.56, 0.66), "horizon": (1.00, 0.72, 0.38),
        "light": (1.00, 0.86, 0.62), "shade": (0.52, 0.42, 0.62), "sun": (1.00, 0.93, 0.62),
        "hill": (0.38, 0.36, 0.58), "field": (0.74, 0.52, 0.20), "meadow": (0.36, 0.42, 0.20),
        "dark": (0.09, 0.11, 0.17), "leaf": (0.38, 0.40, 0.14), "flower": (0.93, 0.68, 0.20),
    },
    {  # a clear morning
        "zenith": (0.24, 0.48, 0.78), "sky": (0.56, 0.77, 0.88), "horizon": (0.96, 0.93, 0.82),
        "light": (1.00, 0.99, 0.93), "shade": (0.62, 0.68, 0.80), "sun": (1.00, 1.00, 0.90),
        "hill": (0.46, 0.58, 0.72), "field": (0.72, 0.74, 0.34), "meadow": (0.44, 0.62, 0.26),
        "dark": (0.10, 0.22, 0.18), "leaf": (0.40, 0.56, 0.18), "flower": (0.93, 0.90, 0.90),
    },
)  # fmt: skip


@dataclass(frozen=True)
class Facet:
    """A flat polygon: a wall or a roof.

    Attributes
    ----------
    corners
        ``(corner, 2)`` of a convex outline, (x, y) as shares of the picture.
    colour
        sRGB.
    down
        Whether its strokes run downwards rather than across.
    """

    corners: NDArray[np.float64]
    colour: NDArray[np.float32]
    down: bool


@dataclass(frozen=True)
class Landscape:
    """The scene to paint, at low resolution.

    Attributes
    ----------
    colour
        ``(y, x, 3)`` sRGB, 0 .. 1.
    angle
        ``(y, x)`` direction of the brush, radians from +x towards +row.
    detail
        ``(y, x)`` 0 .. 1: large values need a small brush.
    body
        ``(y, x)`` 0 .. 1: thickness of the paint; thick in lights, thin in darks.
    matter
        ``(y, x)`` class: SKY, CLOUD, HILL ...
    sun
        (x, y) of the sun in cells, and its radius.
    mood
        Named colours.
    facets
        Walls and roofs, far to near.
    """

    colour: Field
    angle: Field
    detail: Field
    body: Field
    matter: NDArray[np.int32]
    sun: tuple[float, float, float]
    mood: dict[str, NDArray[np.float32]]
    facets: list[Facet]


def landscape(rng: np.random.Generator, size: tuple[int, int]) -> Landscape:
    """A landscape for a picture of ``size`` (rows, columns)."""
    scale = min(1.0, LONGEST / max(size))
    shape = (max(8, round(size[0] * scale)), max(8, round(size[1] * scale)))
    sketch = _Sketch(rng, shape)
    sketch.sky()
    sketch.hills()
    sketch.ground()
    sketch.river()
    sketch.trees()
    sketch.house()
    sketch.grass()
    return sketch.finished()


class _Sketch:
    def __init__(self, rng: np.random.Generator, shape: tuple[int, int]) -> None:
        self.rng, self.shape = rng, shape
        rows, columns = shape
        self.unit = float(np.sqrt(rows * columns))
        self.x, self.y = np.meshgrid(
            (np.arange(columns, dtype=np.float32) + 0.5) / columns,
            (np.arange(rows, dtype=np.float32) + 0.5) / rows,
        )
        self.aspect = columns / rows
        mood = MOODS[int(rng.integers(len(MOODS)))]
        self.mood = {name: np.array(value, np.float32) for name, value in mood.items()}
        self.horizon = float(rng.uniform(0.44, 0.56))
        side = 1 if rng.random() < 0.5 else -1
        self.sun = (
            0.5 + side * float(rng.uniform(0.10, 0.30)),
            self.horizon * float(rng.uniform(0.36, 0.66)),
        )
        self.side = side
        self.vanish = float(rng.uniform(0.35, 0.65))
        self.colour = np.zeros((*shape, 3), np.float32)
        self.angle = np.zeros(shape, np.float32)
        self.detail = np.zeros(shape, np.float32)
        self.body = np.zeros(shape, np.float32)
        self.matter = np.full(shape, SKY, np.int32)
        self.facets: list[Facet] = []

    def fractal(self, cell: float | tuple[float, float], octaves: int = 4) -> Field:
        """Noise with features of ``cell`` of the picture."""
        pair = (cell, cell) if isinstance(cell, float) else cell
        return fractal(self.rng, self.shape, (pair[0] * self.unit, pair[1] * self.unit), octaves)

    def put(
        self,
        where: NDArray[np.floating],
        colour: NDArray[np.floating],
        matter: int | None = None,
        angle: NDArray[np.floating] | float | None = None,
        detail: float | None = None,
        body: NDArray[np.floating] | float | None = None,
    ) -> None:
        """Blend a colour by ``where``; the other planes are set where it is above one half."""
        self.colour += where[..., None] * (np.broadcast_to(colour, self.colour.shape) - self.colour)
        inside = where > 0.5
        for plane, value in ((self.angle, angle), (self.detail, detail), (self.body, body)):
            if value is not None:
                plane[inside] = np.broadcast_to(np.float32(value), self.shape)[inside]
        if matter is not None:
            self.matter[inside] = matter

    def mix(self, first: str, second: str, share: Field) -> Field:
        """A mixture of two colours of the mood, ``(y, x, 3)``."""
        a, b = self.mood[first], self.mood[second]
        return np.asarray(a + np.asarray(share)[..., None] * (b - a), np.float32)

    def sky(self) -> None:
        t = np.clip(self.y / self.horizon, 0.0, 1.0) + 0.05 * self.fractal(0.3)
        air = self.mix("zenith", "sky", smoothstep(0.0, 0.50, t))
        air += smoothstep(0.38, 0.86, t)[..., None] * (self.mood["horizon"] - air)
        dx, dy = (self.x - self.sun[0]) * self.aspect, self.y - self.sun[1]
        distance = np.sqrt(dx * dx + dy * dy)
        glow = np.exp(-distance / 0.11)
        air += np.sqrt(0.6 * glow)[..., None] * (self.mood["horizon"] - air)
        air += glow[..., None] * (self.mood["sun"] - air)
        whirl = self.fractal(0.30, 2)
        gy, gx = np.gradient(whirl * 0.30 * self.unit)
        ring = 1.6 * np.exp(-((distance / 0.22) ** 2))
        calm = 2.5 * smoothstep(0.55, 1.0, t)
        flow_x = 1.0 + calm + 1.1 * gy - ring * dy / (distance + 0.02)
        flow_y = -1.1 * gx + ring * dx / (distance + 0.02)
        angle = np.arctan2(flow_y, flow_x)
        self.put(np.ones(self.shape, np.float32), air, SKY, angle, 0.12, 0.30 + 0.5 * glow)
        self._clouds(angle)
        disc = smoothstep(0.036, 0.028, distance)
        around = np.arctan2(dx, -dy)
        self.put(disc, self.mood["sun"], CLOUD, around, 0.8, 1.0)

    def _clouds(self, angle: Field) -> None:
        puff = self.fractal((0.13, 0.34), 5) + 0.35 * self.fractal(0.06, 3)
        cover = smoothstep(0.35, 0.95, puff - 0.5 * np.abs(self.y / self.horizon - 0.45))
        sunward = np.sign(self.sun[0] - 0.5)
        thickness = blur(puff, 0.018 * self.unit)
        gy, gx = np.gradient(thickness)
        lit = (gy * 1.0 - sunward * gx * 0.6) * self.unit * 0.05
        tone = smoothstep(-0.60, 0.60, lit + 0.15 * puff)
        self.put(
            0.92 * cover, self.mix("shade", "light", tone), CLOUD, angle, 0.45, 0.35 + 0.6 * tone
        )

    def hills(self) -> None:
        ranges = int(self.rng.integers(2, 4))
        for index in range(ranges):
            near = (index + 1) / ranges
            profile = fractal(
                self.rng, (1, self.shape[1]), (4, (0.34 - 0.10 * near) * self.unit), 4
            )
            top = self.horizon - 0.085 * (1.25 - near) - 0.035 * profile
            top = top + 0.05 * near * (self.x[:1] - 0.5) * self.side
            inside = smoothstep(-0.5, 0.5, (self.y - top) * self.shape[0])
            haze = self.mix("hill", "meadow", np.full(self.shape, 0.15 + 0.55 * near**1.5))
            slope = np.gradient(
                blur(np.broadcast_to(top, self.shape).astype(np.float32), 2.0), axis=1
            )
            slope *= self.shape[0]
            light = smoothstep(-0.6, 0.6, 2.2 * slope * -self.side + 0.35 * self.fractal(0.06, 3))
            shaded = haze * (0.70 + 0.45 * light[..., None])
            shaded += (0.24 * light * near)[..., None] * (self.mood["field"] - shaded)
            mist = np.exp(-np.clip(self.horizon - self.y, 0, 1) / 0.03) * (1.0 - near) * 0.4
            shaded += mist[..., None] * (self.mood["horizon"] - shaded)
            fall = np.arctan(slope) + 0.9 * smoothstep(0.0, 0.10, self.y - top) * -self.side
            self.put(
                inside, shaded, HILL, fall + 0.15 * self.fractal(0.1, 2), 0.35, 0.25 + 0.3 * light
            )

    def ground(self) -> None:
        depth = np.clip((self.y - self.horizon) / (1.0 - self.horizon), 0.0, 1.0)
        self.depth = depth
        across = (self.x - self.vanish) * self.aspect / (depth + 0.06)
        far = 1.0 / (depth + 0.10)
        warp = 0.5 * self.fractal(0.22, 3)
        parcel = np.floor(far * 0.75 + 0.12 * warp) + 0.0
        which = np.floor(across * 0.55 + 1.7 * np.sin(parcel * 12.9) + 0.15 * warp)
        draw = np.mod(np.sin(parcel * 127.1 + which * 311.7) * 43758.5453, 1.0)
        wheat = self.mood["field"] * (0.86 + 0.22 * np.mod(draw * 7.0, 1.0))[..., None]
        grass = self.mood["meadow"] * (0.78 + 0.40 * np.mod(draw * 5.0, 1.0))[..., None]
        colour = np.where((draw < 0.52)[..., None], wheat, grass).astype(np.float32)
        plough = np.array([0.50, 0.34, 0.28], np.float32)
        colour = np.where((draw > 0.88)[..., None], 0.5 * plough + 0.5 * colour, colour)
        furrow = np.sin(across * 26.0 + 2.0 * warp) * smoothstep(0.05, 0.4, depth)
        colour = colour * (1.0 + 0.09 * furrow[..., None] + 0.07 * self.fractal(0.05, 3)[..., None])
        distance = np.exp(-depth / 0.22)[..., None]
        colour += 0.42 * distance * (0.5 * self.mood["hill"] + 0.5 * self.mood["horizon"] - colour)
        inside = smoothstep(-0.5, 0.5, (self.y - self.horizon) * self.shape[0])
        to_vanish = np.arctan2(self.y - self.horizon + 0.02, (self.x - self.vanish) * self.aspect)
        angle = np.where(draw < 0.45, to_vanish, 0.08 * self.fractal(0.15, 2))
        self.put(inside, colour, FIELD, angle, 0.30, 0.40 + 0.25 * (draw < 0.52))

    def river(self) -> None:
        d = self.depth
        swing, phase = self.rng.uniform(0.10, 0.20), self.rng.uniform(0, 2 * np.pi)
        middle = self.vanish + swing * np.sin(5.2 * np.sqrt(d + 0.01) * 2 + phase) * (0.25 + d)
        middle = middle + 0.35 * (self.sun[0] - self.vanish) * np.exp(-d * 3)
        half = (0.012 + 0.17 * d**1.6) / np.sqrt(self.aspect)
        off = np.abs(self.x - middle + 0.006 * self.fractal(0.04, 3)) / half
        water = smoothstep(1.0 + 0.03 / (d + 0.05), 1.0, off) * (self.y > self.horizon + 0.008)
        mirrored = np.clip(1.9 * self.horizon - self.y * 0.9, 0.0, 1.0)
        t = smoothstep(0.0, 1.0, mirrored / self.horizon)
        colour = self.mix("zenith", "horizon", t**1.3) * 0.90
        colour += (
            0.30
            * np.exp(-(((self.x - self.sun[0]) / 0.10) ** 2))[..., None]
            * (self.mood["sun"] - colour)
        )
        bank = smoothstep(1.45, 1.0, off) * (self.y > self.horizon + 0.012)
        self.put(0.65 * bank, self.mood["dark"] * 1.7, None, None, 0.5, 0.3)
        self.put(water, colour, WATER, 0.03 * self.fractal(0.1, 2), 0.45, 0.30)

    def trees(self) -> None:
        count = int(self.rng.integers(5, 9))
        depth = np.sort(self.rng.uniform(0.03, 0.42, count) ** 1.15)
        depth[-1] = self.rng.uniform(0.42, 0.62)
        for index, d in enumerate(depth):
            last = index == count - 1
            x = (
                (0.5 - self.side * self.rng.uniform(0.26, 0.40))
                if last
                else self.rng.uniform(0.02, 0.98)
            )
            base = self.horizon + d * (1.0 - self.horizon)
            tall = bool(self.rng.random() < 0.55) or last
            size = (0.07 + 0.62 * d) * self.rng.uniform(0.8, 1.15) * (1.15 if tall else 0.75)
            self._tree(x, base, size, tall, float(np.exp(-d / 0.16)))

    def _tree(self, x: float, base: float, size: float, tall: bool, haze: float) -> None:
        v = (base - self.y) / size
        u = (self.x - x) * self.aspect / size
        ragged = 0.30 * self.fractal(0.022, 3) + 0.20 * self.fractal(0.06, 2)
        if tall:
            outline = 0.155 * np.sqrt(np.clip(np.sin(np.pi * np.clip(v, 0, 1) ** 0.62), 0, 1))
            inside = outline * (1.0 + ragged) - np.abs(u + 0.02 * np.sin(5 * v)) - 0.006
        else:
            crown = np.sqrt(((v - 0.62) / 0.40) ** 2 + (u / 0.46) ** 2) + 0.28 * ragged
            trunk = np.where((v > 0) & (v < 0.5), 0.035 - np.abs(u + 0.03 * v), -1.0)
            inside = np.maximum(0.3 * (1.0 - crown), trunk)
        where = smoothstep(-0.006, 0.012, inside) * ((v > 0.0) & (v < 1.02))
        facing = np.sign(self.sun[0] - x) or 1.0
        light = smoothstep(
            -0.10, 0.22, facing * u + 0.15 * (v - 0.5) + 0.06 * self.fractal(0.03, 3)
        )
        colour = self.mix("dark", "leaf", 0.85 * light)
        colour += (0.25 * light * light)[..., None] * (self.mood["light"] - colour)
        colour += 0.45 * haze * (self.mood["hill"] - colour)
        shade = smoothstep(
            1.0,
            0.2,
            np.sqrt(((self.y - base) / (0.07 * size)) ** 2 + ((u + 0.25 * facing) / 0.55) ** 2),
        )
        self.put(0.55 * shade, self.mood["dark"] * 1.3, None, None, None, 0.2)
        angle = np.pi / 2 + (2.2 * u if tall else 3.0 * u) + 0.35 * self.fractal(0.05, 2)
        self.put(where, colour, TREE, angle, 0.75, 0.30 + 0.55 * light)

    def house(self) -> None:
        for _ in range(int(self.rng.integers(1, 3))):
            left = 0.5 + self.side * self.rng.uniform(0.0, 0.30)
            base = self.horizon + self.rng.uniform(0.05, 0.11)
            self._house(float(np.clip(left, 0.06, 0.86)), base, self.rng.uniform(0.07, 0.10))

    def _house(self, left: float, base: float, width: float) -> None:
        import cv2

        rows, columns = self.shape
        w, h = width * self.unit, 0.62 * width * self.unit
        white = self.mood["light"]
        shade = 0.55 * self.mood["shade"] + 0.25 * self.mood["hill"]
        front, gable = (shade, white) if self.side > 0 else (white, shade)
        roof = np.array([0.74, 0.31, 0.18], np.float32)
        hole = self.mood["dark"] * 1.6
        parts: list[tuple[NDArray[np.float32], bool, list[tuple[float, float]]]] = [
            # Corners in widths and heights of the front wall; True: painted downwards.
            (front, True, [(0, 0), (1, 0), (1, 1), (0, 1)]),
            (gable, True, [(1, 0), (1.5, 0.09), (1.5, 1), (1.25, 1.58), (1, 1)]),
            (roof, False, [(-0.06, 0.96), (1, 0.96), (1.27, 1.62), (0.2, 1.62)]),
            (hole, True, [(0.42, 0), (0.55, 0), (0.55, 0.52), (0.42, 0.52)]),
            (hole, True, [(0.14, 0.42), (0.26, 0.42), (0.26, 0.68), (0.14, 0.68)]),
            (hole, True, [(0.72, 0.42), (0.84, 0.42), (0.84, 0.68), (0.72, 0.68)]),
        ]
        for colour, down, corners in parts:
            points = np.array([[left * columns + w * a, base * rows - h * b] for a, b in corners])
            cover = np.zeros(self.shape, np.uint8)
            fixed = np.round(points * 16).astype(np.int32)
            cv2.fillPoly(cover, [fixed], 255, cv2.LINE_AA, shift=4)
            self.put(cover.astype(np.float32) / 255, colour, HOUSE, np.pi / 2 * down, 0.3, 0.5)
            self.facets.append(Facet(points / (columns, rows), colour, down))

    def grass(self) -> None:
        edge = 0.80 + 0.05 * self.fractal(0.2, 3) + 0.10 * np.abs(self.x - 0.5 + 0.3 * self.side)
        where = smoothstep(-0.02, 0.03, self.y - edge)
        clumps = smoothstep(-0.8, 1.0, self.fractal((0.05, 0.04), 4))
        colour = self.mix("dark", "meadow", 0.25 + 0.75 * clumps)
        colour += (0.3 * clumps**2)[..., None] * (self.mood["field"] - colour)
        colour *= (1.0 - 0.45 * smoothstep(0.86, 1.0, self.y))[..., None]
        lean = -np.pi / 2 + 0.35 * self.fractal(0.12, 2)
        self.put(where, colour, GRASS, lean, 0.55, 0.30 + 0.3 * clumps)

    def finished(self) -> Landscape:
        colour = np.clip(self.colour, 0.02, 1.0)
        grey = colour @ np.array([0.3, 0.59, 0.11], np.float32)
        gy, gx = np.gradient(blur(grey, 1.0))
        edges = smoothstep(0.02, 0.12, np.hypot(gx, gy))
        detail = np.maximum(self.detail, 0.85 * blur(edges, 1.2))
        body = np.clip(self.body * (0.45 + 0.75 * grey), 0.0, 1.0)
        rows, columns = self.shape
        sun = (self.sun[0] * columns, self.sun[1] * rows, 0.030 * rows)
        return Landscape(
            colour=colour,
            angle=self.angle,
            detail=np.clip(detail, 0.0, 1.0),
            body=body,
            matter=self.matter,
            sun=sun,
            mood=self.mood,
            facets=self.facets,
        )
