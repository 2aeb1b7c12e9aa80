"""Strokes of paint: bristles, loaded paint, overlapping without mixing.

Each pixel of the paint layer holds two paints and the share of the second. A stroke covers what
lies below (except under its antialiased rim), flattens the relief below and adds its own: grooves
of the bristles, ridges where paint was pushed aside, a lip where the brush was lifted.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from impasto.simulate.fields import Field, blur, noise, smoothstep

BRISTLE, DAB, LINER, KNIFE = range(4)
"""Tools: a flat hog-bristle brush, a short touch, a thin rigger, the palette knife."""

VARIANTS = 10


@dataclass(frozen=True)
class Strokes:
    """Strokes in painting order; arrays are ``(count,)`` unless stated otherwise.

    Attributes
    ----------
    x, y
        Middle of the stroke in pixels (column, row).
    angle
        Direction of the pull in radians, from +x towards +row.
    length, width
        In pixels.
    bend
        Sideways bulge over the whole stroke, as a share of its length.
    colour, second
        ``(count, 3)`` wanted CIE L*a*b* of the paint and of the streaks in it.
    body
        Thickness of the paint in mm.
    tool
        One of BRISTLE, DAB, LINER, KNIFE.
    """

    x: NDArray[np.float32]
    y: NDArray[np.float32]
    angle: NDArray[np.float32]
    length: NDArray[np.float32]
    width: NDArray[np.float32]
    bend: NDArray[np.float32]
    colour: NDArray[np.float32]
    second: NDArray[np.float32]
    body: NDArray[np.float32]
    tool: NDArray[np.int32]

    def __len__(self) -> int:
        return len(self.x)

    def pick(self, index: NDArray[np.integer] | NDArray[np.bool_]) -> Strokes:
        """Some of the strokes, in the order of ``index``."""
        return Strokes(*(getattr(self, field.name)[index] for field in fields(self)))

    @staticmethod
    def join(groups: list[Strokes]) -> Strokes:
        """The groups one after the other."""
        return Strokes(
            *(np.concatenate([getattr(g, field.name) for g in groups]) for field in fields(Strokes))
        )


@dataclass
class Layer:
    """The wet painting: relief and topmost paint of each pixel.

    Attributes
    ----------
    height
        ``(y, x)`` mm.
    first, second
        ``(y, x)`` index of a recipe.
    share
        ``(y, x)`` share of ``second``, 0 .. 1.
    paint
        ``(y, x)`` mm of paint above the ground.
    """

    height: Field
    first: NDArray[np.int32]
    second: NDArray[np.int32]
    share: Field
    paint: Field


def lay(
    layer: Layer,
    strokes: Strokes,
    first: NDArray[np.int32],
    second: NDArray[np.int32],
    rng: np.random.Generator,
    pitch_mm: float,
) -> None:
    """Paint strokes on the layer, in order; ``first`` and ``second`` are their recipes."""
    import cv2

    rows, columns = layer.height.shape
    stamps = _Stamps(rng, pitch_mm)
    variant = rng.integers(0, VARIANTS, len(strokes))
    # A small picture has thousands of strokes of a few pixels: what can be is done for all at once.
    planes = (
        strokes.x, strokes.y, np.cos(strokes.angle), np.sin(strokes.angle), strokes.length,
        strokes.width, strokes.bend, strokes.body, first, second,
        *stamps.keys(strokes, variant),
    )  # fmt: skip
    for x, y, cos, sin, length, width, bend, body, one, other, *key in zip(
        *(plane.tolist() for plane in planes), strict=True
    ):
        half_u, half_v = 0.5 * length, 0.5 * width + abs(bend) * length
        reach_x = half_u * abs(cos) + half_v * abs(sin) + 1.0
        reach_y = half_u * abs(sin) + half_v * abs(cos) + 1.0
        left, right = max(0, int(x - reach_x)), min(columns, int(x + reach_x) + 2)
        top, bottom = max(0, int(y - reach_y)), min(rows, int(y + reach_y) + 2)
        if left >= right or top >= bottom:
            continue
        dx = np.arange(left, right, dtype=np.float32)[None, :] - np.float32(x)
        dy = np.arange(top, bottom, dtype=np.float32)[:, None] - np.float32(y)
        u = cos * dx + sin * dy
        v = -sin * dx + cos * dy
        # A parabola: the middle line of the stroke bulges by `bend` times its length.
        v += bend * length * (1.0 - (2.0 / length * u) ** 2)
        stamp = stamps.get(*key)
        scale_v, scale_u = stamp.shape[0] - 1.0, stamp.shape[1] - 1.0
        sampled = cv2.remap(
            stamp,
            u * (scale_u / length) + 0.5 * scale_u,
            v * (scale_v / width) + 0.5 * scale_v,
            cv2.INTER_LINEAR,
            borderMode=cv2.BORDER_CONSTANT,
            borderValue=0.0,
        )
        window = np.s_[top:bottom, left:right]
        cover, relief, streak = cv2.split(sampled)
        _press(layer, window, cover, relief, body)
        _cover(layer, window, cover, streak, one, other)


def _press(
    layer: Layer, window: tuple[slice, slice], cover: Field, profile: Field, body: float
) -> None:
    """Level the relief under the stroke, then add that of the stroke."""
    import cv2

    height, paint = layer.height[window], layer.paint[window]
    # A loaded brush fills the relief below; thin paint follows every thread.
    level = 0.02 + 0.83 * min(max((body - 0.015) / 0.16, 0.0), 1.0) ** 0.8
    mean = cv2.blur(height, (7, 7), borderType=cv2.BORDER_REFLECT)
    mean_paint = cv2.blur(paint, (7, 7), borderType=cv2.BORDER_REFLECT)
    relief = body * profile
    height += cover * (level * (mean - height) + relief)
    paint += cover * (level * (mean_paint - paint) + relief)


def _cover(
    layer: Layer,
    window: tuple[slice, slice],
    cover: Field,
    streak: Field,
    first: int,
    second: int,
) -> None:
    """Replace the colour where the stroke covers; its rim shares the pixel with the old one."""
    old_first, old_second = layer.first[window], layer.second[window]
    share = layer.share[window]
    rim_in = (cover > 0.5) & (cover < 0.92)
    rim_out = (cover > 0.08) & (cover <= 0.5)
    inside = cover >= 0.92
    np.copyto(old_second, old_first, where=rim_in)
    np.copyto(old_second, second, where=inside | rim_out)
    np.copyto(old_second, first, where=rim_out)
    np.copyto(old_first, first, where=inside | rim_in)
    np.copyto(share, streak, where=inside)
    np.copyto(share, np.minimum(cover, 1.0 - cover), where=rim_in | rim_out)


class _Stamps:
    """Textures of single touches, made when first needed: (v, u, [cover, relief, streak])."""

    def __init__(self, rng: np.random.Generator, pitch_mm: float) -> None:
        self._seed = int(rng.integers(0, 2**31))
        self._bristle = max(0.42 / pitch_mm, 2.2)
        self._made: dict[tuple[int, int, int, int], Field] = {}

    @staticmethod
    def keys(strokes: Strokes, variant: NDArray[np.integer]) -> tuple[NDArray[np.integer], ...]:
        """What each stroke asks for: tool, size (those within a quarter share one) and variant."""
        width, length = strokes.width.astype(np.float64), strokes.length.astype(np.float64)
        across = np.rint(4.0 * np.log2(np.maximum(width, 1.0))).astype(np.int64)
        along = np.rint(2.0 * np.log2(np.maximum(length, 1.0))).astype(np.int64)
        return strokes.tool, across, along, variant

    def get(self, tool: int, across: int, along: int, variant: int) -> Field:
        """The texture for a touch of some :meth:`keys`."""
        key = (tool, across, along, variant)
        if key not in self._made:
            rng = np.random.default_rng([self._seed, *key])
            self._made[key] = _touch(
                rng, tool, 2.0 ** (across / 4), 2.0 ** (along / 2), self._bristle
            )
        return self._made[key]


def _touch(
    rng: np.random.Generator, tool: int, width: float, length: float, bristle: float
) -> Field:
    """Texture ``(v, u, 3)`` of one touch, about two texels per pixel."""
    rows = int(np.clip(2 * width, 6, 160)) + 2
    columns = int(np.clip(1.5 * length, 10, 240)) + 2
    v = np.linspace(-1.0, 1.0, rows, dtype=np.float32)[:, None]
    u = np.linspace(0.0, 1.0, columns, dtype=np.float32)[None, :]
    texel_v = rows / width
    grooves = noise(rng, (rows, columns), (0.55 * bristle * texel_v, columns / 2.2))
    grooves += 0.5 * noise(rng, (rows, columns), (0.3 * bristle * texel_v, columns / 4.0))
    streak = smoothstep(
        -0.4, 1.5, noise(rng, (rows, columns), (0.8 * bristle * texel_v, columns / 1.3))
    )
    ragged = noise(rng, (rows, columns), (0.35 * bristle * texel_v, columns / 5.0))
    wobble = 0.10 * noise(rng, (rows, columns), (rows, columns / 3.0))
    edge = np.abs(v + wobble)
    if tool == KNIFE:
        return _knife(rng, u, v, edge, grooves, streak)
    if tool == LINER:
        taper = np.sqrt(np.clip(1.0 - u, 0.0, 1.0)) * smoothstep(0.0, 0.12, u)
        body = np.sqrt(np.clip(1.0 - (edge / np.maximum(taper, 0.05)) ** 2, 0.0, 1.0))
        cover = smoothstep(0.05, 0.35, body)
        return _stack(cover, 0.9 * body + 0.08 * grooves, 0.7 * streak)
    if tool == DAB:
        along = 2.0 * u - 1.0 + 0.15 * noise(rng, (rows, columns), (rows / 3, columns))
        radius = np.sqrt(edge**2.4 + np.abs(along) ** 2.6) + 0.04 * ragged
        cover = smoothstep(1.0, 0.86, radius)
        ridge = np.exp(-(((radius - 0.80) / 0.13) ** 2))
        lift = smoothstep(0.1, 0.9, u)
        relief = 0.45 + 0.5 * lift + 0.45 * ridge * (0.4 + lift) + 0.16 * grooves
        return _stack(cover, cover * np.maximum(relief, 0.05), 0.8 * streak)
    # The bristle brush: blunt start, paint running out, dry and ragged at the end.
    load = 1.0 - 0.55 * smoothstep(0.15, 1.0, u)
    rounding = 0.10 * (1.0 - np.sqrt(np.clip(1.0 - v * v, 0.0, 1.0)))
    start = smoothstep(0.0, 0.05, u - rounding + 0.02 * ragged)
    dry = smoothstep(0.55, 1.05, u + rounding) * 1.9
    finish = smoothstep(0.0, 0.35, 1.15 + 0.55 * ragged + 0.35 * grooves - 1.35 * dry)
    cover = start * finish * smoothstep(1.0, 0.90, edge + 0.05 * ragged)
    ridge = np.exp(-(((edge - 0.84) / 0.11) ** 2))
    lip = np.exp(-(((u - 0.93) / 0.03) ** 2)) * smoothstep(0.9, 0.3, edge)
    relief = load * (0.62 + 0.30 * grooves) + 0.42 * ridge * (0.5 + 0.5 * load) + 0.25 * lip
    return _stack(cover, np.maximum(relief, 0.04), streak)


def _knife(
    rng: np.random.Generator, u: Field, v: Field, edge: Field, grooves: Field, streak: Field
) -> Field:
    """A slab: flat on top, raised at its rims, torn at its end."""
    shape = edge.shape
    tear = noise(rng, shape, (shape[0] / 6, shape[1] / 9))
    slope = 0.12 * float(rng.standard_normal()) * v
    cover = smoothstep(1.0, 0.93, edge) * smoothstep(0.0, 0.03, u + 0.02 * tear)
    cover = cover * smoothstep(0.0, 0.08, 0.98 - u + 0.10 * tear)
    rim = np.exp(-(((edge - 0.90) / 0.06) ** 2)) + 0.8 * np.exp(-(((u - 0.92) / 0.05) ** 2))
    chatter = 0.05 * np.sin(2 * np.pi * (7 + 6 * rng.random()) * u + 2.0 * tear)
    relief = 0.72 + slope + 0.55 * rim + chatter * smoothstep(0.2, 0.8, u) + 0.05 * grooves
    return _stack(cover, np.maximum(relief, 0.05), smoothstep(0.2, 0.8, streak))


def _stack(cover: Field, relief: Field, streak: Field) -> Field:
    """One texture with a rim of 0, so that samples outside are 0."""
    texture = np.dstack(np.broadcast_arrays(cover, relief, streak)).astype(np.float32)
    texture[0], texture[-1] = 0.0, 0.0
    texture[:, 0], texture[:, -1] = 0.0, 0.0
    return np.ascontiguousarray(texture)


def level(layer: Layer, pitch_mm: float) -> None:
    """Level the wet paint: features below 0.1 mm disappear."""
    layer.height[:] = blur(layer.height, 0.09 / pitch_mm)
