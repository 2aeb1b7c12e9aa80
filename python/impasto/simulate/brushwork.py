"""From a landscape to strokes: large brushes first, lights and accents last."""

from __future__ import annotations

from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from impasto.simulate import landscape as area
from impasto.simulate.fields import blur
from impasto.simulate.landscape import Landscape
from impasto.simulate.pigments import lab_from_srgb
from impasto.simulate.strokes import BRISTLE, DAB, KNIFE, LINER, Strokes

Where: TypeAlias = NDArray[np.floating[Any]]


class Painter:
    """Plans the strokes of one picture.

    Parameters
    ----------
    landscape
        The scene to paint.
    size
        Rows and columns of the picture in pixels.
    pitch_mm
        Width of a pixel in mm.
    rng
        Random numbers of the strokes.
    """

    def __init__(
        self, landscape: Landscape, size: tuple[int, int], pitch_mm: float, rng: np.random.Generator
    ) -> None:
        self.land, self.size, self.rng = landscape, size, rng
        self.unit = float(np.sqrt(size[0] * size[1]))
        """Side in px of a square picture of the same area: brushes scale with it."""
        # Thick paint on a large picture is not thicker in proportion.
        self.body_mm = float(1.3 * np.clip((self.unit * pitch_mm / 100.0) ** 0.35, 0.4, 1.6))
        self.lab = lab_from_srgb(landscape.colour).astype(np.float32)

    def plan(self) -> Strokes:
        """All strokes in order."""
        groups = [
            self.pass_(0.085, 0.66, 0.00, (0.010, 0.02), 0.0),
            self.pass_(0.045, 0.62, 0.04, (0.008, 0.10), 0.0),
            self.pass_(0.026, 0.74, 0.08, (0.010, 0.15), 0.28),
            self.pass_(0.015, 0.80, 0.08, (0.012, 0.13), 0.55),
            self.clouds(),
            self.water(),
            self.foliage(),
            self.walls(),
            self.meadow(),
            self.sun(),
            self.signature(),
        ]
        return Strokes.join([group for group in groups if len(group)])

    def at(self, plane: NDArray[np.floating] | NDArray[np.integer], x: Where, y: Where) -> Where:
        """A plane of the landscape at pixels."""
        rows, columns = self.land.angle.shape
        row = np.clip((y + 0.5) / self.size[0] * rows, 0, rows - 1).astype(np.int32)
        column = np.clip((x + 0.5) / self.size[1] * columns, 0, columns - 1).astype(np.int32)
        return np.asarray(plane[row, column])

    def pass_(
        self, brush: float, step: float, jitter: float, body: tuple[float, float], detail: float
    ) -> Strokes:
        """Cover cells of at least this ``detail``; ``brush`` is a width as a share of the side."""
        width = max(brush * self.unit, 3.0)
        spacing = step * width
        rows, columns = self.size
        grid_y, grid_x = np.mgrid[
            -spacing : rows + spacing : spacing, -spacing : columns + spacing : spacing
        ]
        count = grid_x.size
        shake = self.rng.uniform(-0.6, 0.6, (2, count)) * spacing
        x, y = grid_x.ravel() + shake[0], grid_y.ravel() + shake[1]
        keep = (self.at(self.land.detail, x, y) + self.rng.uniform(-0.12, 0.12, count)) >= detail
        if detail == 0.0:
            keep[:] = True
        order = self.rng.permutation(count)
        order = order[keep[order]]
        x, y = x[order], y[order]
        matter = self.at(self.land.matter, x, y)
        stretch = np.array([3.4, 2.6, 2.4, 2.8, 3.4, 1.9, 1.5, 2.6])[matter]
        small = np.array([1.0, 0.9, 0.9, 0.85, 0.75, 0.70, 0.42, 0.6])[matter]
        wide = width * small * self.rng.uniform(0.75, 1.2, len(x))
        return self.strokes(
            x, y,
            length=wide * stretch * self.rng.uniform(0.7, 1.25, len(x)),
            width=wide,
            wander=0.12 + 0.25 * (matter == area.TREE),
            jitter=jitter,
            body=body[0] + body[1] * self.at(self.land.body, x, y),
            tool=BRISTLE,
        )  # fmt: skip

    def strokes(
        self,
        x: Where,
        y: Where,
        *,
        length: Where | float,
        width: Where | float,
        body: Where | float,
        tool: NDArray[np.integer] | int,
        angle: Where | float | None = None,
        colour: Where | None = None,
        second: Where | None = None,
        wander: Where | float = 0.12,
        jitter: float = 0.06,
        bend: float = 0.06,
    ) -> Strokes:
        """Strokes at pixels; defaults follow the landscape."""
        count = len(x)
        if angle is None:
            angle = self.at(self.land.angle, x, y)
        if colour is None:
            colour = self.at(self.lab, x, y)
        if second is None:
            # The brush still carries paint from a little way off.
            off = self.rng.normal(0.0, 0.05 * self.unit, (2, count))
            away = self.at(self.lab, x + off[0], y + 0.3 * off[1])
            second = colour + 0.35 * np.clip(away - colour, -25, 25)
        # Broken colour: neighbours differ in hue and warmth more than in lightness.
        spread = jitter * np.array([42.0, 60.0, 75.0])
        shake = self.rng.standard_normal((2, count, 3)) * spread
        full = np.ones(count)
        turn = self.rng.standard_normal(count) * wander
        return Strokes(
            x=_f32(x),
            y=_f32(y),
            angle=_f32(angle + turn),
            length=_f32(length * full),
            width=_f32(np.maximum(width * full, 1.6)),
            bend=_f32(self.rng.standard_normal(count) * bend),
            colour=_f32(colour + shake[0]),
            second=_f32(second + 1.3 * shake[1]),
            body=_f32(self.body_mm * (body * full)),
            tool=np.full(count, 0, np.int32) + np.asarray(tool, np.int32),
        )

    def scatter(self, weight: NDArray[np.floating], count: int) -> tuple[Where, Where]:
        """``count`` random pixels with probabilities ``weight`` (a plane of the landscape)."""
        share = weight.ravel().astype(np.float64)
        if share.sum() <= 0.0:
            return np.zeros(0, np.float32), np.zeros(0, np.float32)
        rows, columns = weight.shape
        picked = self.rng.choice(weight.size, count, p=share / share.sum())
        row, column = np.divmod(picked, columns)
        x = (column + self.rng.random(count)) / columns * self.size[1] - 0.5
        y = (row + self.rng.random(count)) / rows * self.size[0] - 0.5
        return x, y

    def tinted(self, name: str, count: int) -> Where:
        """A colour of the mood ``(count, 3)`` L*a*b*."""
        return np.repeat(lab_from_srgb(np.array([self.land.mood[name]])), count, axis=0)

    def clouds(self) -> Strokes:
        """Lit rims of clouds: soft bristle first, the knife on the fullest of them."""
        w = self.land
        cloud = (w.matter == area.CLOUD).astype(np.float32)
        full = blur(cloud, 0.02 * float(np.sqrt(cloud.size))) * cloud
        weight = full**3 * np.clip(w.body - 0.35, 0.0, 1.0) ** 2
        x, y = self.scatter(weight, 260)
        count = len(x)
        slabs = np.arange(count) >= 170
        width = self.unit * np.where(
            slabs, self.rng.uniform(0.012, 0.024, count), self.rng.uniform(0.012, 0.030, count)
        )
        colour = self.at(self.lab, x, y)
        share = self.rng.uniform(0.15, 0.8, (count, 1)) + 0.2 * slabs[:, None]
        colour = colour + share * (self.tinted("light", count) - colour)
        return self.strokes(
            x, y, length=width * self.rng.uniform(1.6, 3.0, count), width=width, wander=0.2,
            body=np.where(slabs, self.rng.uniform(0.08, 0.18, count), 0.07),
            tool=np.where(slabs, KNIFE, BRISTLE), colour=colour, jitter=0.05, bend=0.10,
        )  # fmt: skip

    def water(self) -> Strokes:
        """Glitter: short level touches, thickest under the sun."""
        w = self.land
        columns = np.arange(w.angle.shape[1])
        under = np.exp(-(((columns - w.sun[0]) / (0.10 * w.angle.shape[1])) ** 2))
        weight = (w.matter == area.WATER) * (0.15 + under)[None, :]
        x, y = self.scatter(weight, 150)
        count = len(x)
        width = self.unit * self.rng.uniform(0.004, 0.010, count)
        colour = self.at(self.lab, x, y)
        share = self.rng.uniform(0.2, 1.0, (count, 1)) * (
            0.35
            + 0.65
            * under[None, :].T[
                np.clip((x / self.size[1] * len(columns)).astype(int), 0, len(columns) - 1)
            ]
        )
        colour = colour + share * (self.tinted("sun", count) - colour)
        return self.strokes(
            x, y, length=width * self.rng.uniform(3.0, 6.0, count), width=width, angle=0.0,
            wander=0.04, body=0.05 + 0.10 * share[:, 0], tool=BRISTLE, colour=colour,
        )  # fmt: skip

    def foliage(self) -> Strokes:
        """Leaves: dark ones first, then those against the light, thicker."""
        w = self.land
        tree = (w.matter == area.TREE).astype(np.float32)
        groups = []
        for count, lights in ((500, False), (650, True)):
            weight = tree * (
                np.clip(w.body - 0.15, 0, 1) if lights else np.clip(0.5 - w.body, 0, 1)
            )
            x, y = self.scatter(weight, count)
            count = len(x)
            shift = np.array([13.0, -4.0, 13.0]) if lights else np.array([-5.0, 1.0, -3.0])
            colour = self.at(self.lab, x, y)
            colour = colour + shift * self.rng.uniform(0.1, 1.3, (count, 1))
            width = self.unit * self.rng.uniform(0.005, 0.011, count)
            body = self.rng.uniform(0.05, 0.15, count) if lights else 0.03
            groups.append(
                self.strokes(
                    x, y, length=width * self.rng.uniform(1.3, 2.8, count), width=width,
                    wander=0.55, body=body, tool=DAB, colour=colour, jitter=0.08,
                )
            )  # fmt: skip
        return Strokes.join(groups)

    def walls(self) -> Strokes:
        """Walls and roofs, hatched from edge to edge with a small flat brush."""
        groups = []
        for facet in self.land.facets:
            corners = facet.corners * (self.size[1], self.size[0])
            along, across = (1, 0) if facet.down else (0, 1)
            low, high = corners[:, across].min(), corners[:, across].max()
            count = max(2, int(np.ceil((high - low) / max(0.008 * self.unit, 2.0))))
            width = (high - low) / count
            at = low + (np.arange(count) + 0.5) * width
            start, end = _chords(corners[:, across], corners[:, along], at)
            middle = 0.5 * (start + end)
            x, y = (at, middle) if facet.down else (middle, at)
            colour = np.repeat(lab_from_srgb(facet.colour[None]), count, axis=0)
            groups.append(
                self.strokes(
                    x, y, length=np.maximum(end - start, 2.0) + 0.5 * width, width=1.5 * width,
                    angle=np.pi / 2 * facet.down, wander=0.02, bend=0.01, body=0.09, tool=KNIFE,
                    colour=colour, second=colour, jitter=0.06,
                )
            )  # fmt: skip
        return Strokes.join(groups)

    def meadow(self) -> Strokes:
        """Blades, then flowers on top of them."""
        w = self.land
        x, y = self.scatter((w.matter == area.GRASS) * 1.0, 700)
        order = np.argsort(y, kind="stable")
        x, y = x[order], y[order]
        count = len(x)
        colour = self.at(self.lab, x, y)
        colour = colour + self.rng.normal(0.0, 1.0, (count, 1)) * np.array([11.0, -2.0, 8.0])
        near = 0.5 + y / self.size[0]
        blades = self.strokes(
            x, y, length=self.unit * self.rng.uniform(0.03, 0.085, count) * near,
            width=self.unit * self.rng.uniform(0.005, 0.010, count), wander=0.22, bend=0.12,
            body=self.rng.uniform(0.04, 0.11, count), tool=LINER, colour=colour, jitter=0.07,
        )  # fmt: skip
        rows = np.arange(w.angle.shape[0])[:, None] / w.angle.shape[0]
        x, y = self.scatter((w.matter == area.GRASS) * np.exp(-(((rows - 0.86) / 0.06) ** 2)), 75)
        petals = self.rng.integers(1, 5, len(x))
        near = (0.6 + 1.6 * np.clip(y / self.size[0] - 0.75, 0, 1) / 0.25)[:, None]
        bloom = self.unit * 0.008 * near[:, 0] * self.rng.uniform(0.7, 1.3, len(x))
        colour = self.tinted("flower", len(x))
        pale = self.rng.random(len(x)) < 0.3
        colour[pale] = self.tinted("light", int(pale.sum()))
        plant = np.repeat(np.arange(len(x)), petals)
        x, y, bloom, colour = x[plant], y[plant], bloom[plant], colour[plant]
        count = len(x)
        flowers = self.strokes(
            x + self.rng.normal(0, 0.6, count) * bloom, y + self.rng.normal(0, 0.45, count) * bloom,
            length=bloom * self.rng.uniform(1.0, 1.7, count), width=bloom,
            angle=self.rng.uniform(0, np.pi, count), colour=colour,
            second=colour + np.array([12.0, -8.0, 6.0]), jitter=0.06,
            body=self.rng.uniform(0.08, 0.20, count), tool=DAB,
        )  # fmt: skip
        return Strokes.join([blades, flowers])

    def sun(self) -> Strokes:
        """Rings of the thickest paint on the picture."""
        rows, columns = self.land.angle.shape
        x0 = self.land.sun[0] / columns * self.size[1]
        y0 = self.land.sun[1] / rows * self.size[0]
        radius = self.land.sun[2] / rows * self.size[0]
        counts = (30, 24, 18, 13, 8, 4)
        ring = np.repeat([2.6, 2.05, 1.5, 1.05, 0.65, 0.25], counts)
        around = np.concatenate([np.arange(n) / n * 2 * np.pi for n in counts])
        around = around + self.rng.uniform(-0.15, 0.15, len(ring))
        ring = ring + self.rng.uniform(-0.12, 0.12, len(ring))
        x, y = x0 + ring * radius * np.cos(around), y0 + ring * radius * np.sin(around)
        # The halo fades into the air that the strokes lie in.
        halo = np.clip((ring - 0.8) / 2.0, 0, 1)[:, None]
        colour = self.tinted("sun", len(ring))
        air = 0.5 * self.at(self.lab, x, y) + 0.5 * self.tinted("horizon", len(ring))
        colour = colour + halo**0.6 * (air - colour)
        return self.strokes(
            x, y, length=radius * (0.6 + 0.55 * ring), width=0.55 * radius,
            angle=around + np.pi / 2, wander=0.08, bend=-0.03,
            body=np.clip(0.16 - 0.045 * ring, 0.04, None), tool=BRISTLE, colour=colour, jitter=0.04,
        )  # fmt: skip

    def signature(self) -> Strokes:
        """A few quick lines in the lower right corner."""
        letters = np.array(
            [  # x, y, angle, length in letter heights
                (0.0, 0.0, -1.4, 1.0), (0.32, -0.12, 1.0, 0.5), (0.62, -0.12, -1.0, 0.5),
                (0.95, 0.0, 1.5, 1.0), (1.45, 0.15, -1.3, 1.2), (1.7, -0.22, 0.2, 0.5),
                (1.75, 0.02, 0.1, 0.45), (2.3, 0.1, 1.2, 0.7), (2.9, 0.28, 0.05, 1.6),
            ]
        )  # fmt: skip
        tall = 0.026 * self.unit
        x = 0.88 * self.size[1] + (letters[:, 0] - 1.5) * tall
        y = 0.945 * self.size[0] + letters[:, 1] * tall
        ground = self.at(self.lab, x, y)[:, :1].mean()
        colour = np.repeat([[62.0, 22.0, 40.0] if ground < 45 else [28.0, 20.0, 14.0]], len(x), 0)
        return self.strokes(
            x, y, length=letters[:, 3] * tall, width=0.14 * tall, angle=letters[:, 2], wander=0.03,
            body=0.03, tool=LINER, colour=colour, second=colour, jitter=0.0,
        )  # fmt: skip


def _f32(values: Where) -> NDArray[np.float32]:
    return np.asarray(values, dtype=np.float32)


def _chords(across: Where, along: Where, at: Where) -> tuple[Where, Where]:
    """First and last ``along`` of a convex outline on the lines ``across == at``."""
    step = np.linspace(0.0, 1.0, 64)[:, None]
    edge_across = (across + step * (np.roll(across, -1) - across)).ravel()
    edge_along = (along + step * (np.roll(along, -1) - along)).ravel()
    near = np.abs(edge_across - at[:, None]) <= 0.5 * (np.ptp(across) / len(at)) + 1e-9
    start = np.where(near, edge_along, np.inf).min(axis=1)
    end = np.where(near, edge_along, -np.inf).max(axis=1)
    return start, end
