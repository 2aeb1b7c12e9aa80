"""Shapes for path tracing: meshes with the exact normals of the surfaces that they sample.

Lengths are in halves of the picture's side: the camera sees x and y from -1 to 1. World frame: x
right, y up, z to the viewer.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from impasto import simulate

Array = NDArray[np.float64]
Chart = Callable[[Array, Array], Array]
"""(u, v) in 0 .. 1 to points ``(3, ...)``."""
STEP = 1e-5
"""Of central differences in u and v."""
POLE = 1e-3
"""Charts of closed shapes stop before their poles, where a chart has no normal."""


@dataclass(frozen=True, eq=False)
class Mesh:
    """``(n, 3)`` points and unit normals, ``(n, 2)`` texture coordinates, ``(m, 3)`` corners."""

    points: Array
    normals: Array
    texture: Array
    faces: NDArray[np.int32]

    def write(self, path: Path) -> Path:
        """Write a binary PLY file."""
        names = ("x", "y", "z", "nx", "ny", "nz", "u", "v")
        header = ["ply", "format binary_little_endian 1.0", f"element vertex {len(self.points)}"]
        header += [f"property float {name}" for name in names]
        header += [f"element face {len(self.faces)}", "property list uchar int vertex_indices"]
        corners = np.empty(len(self.faces), dtype=[("count", "u1"), ("corner", "<i4", (3,))])
        corners["count"], corners["corner"] = 3, self.faces
        vertices = np.hstack([self.points, self.normals, self.texture]).astype("<f4")
        text = "\n".join([*header, "end_header\n"])
        path.write_bytes(text.encode("ascii") + vertices.tobytes() + corners.tobytes())
        return path


def charted(chart: Chart, across: int, along: int, *, closed: bool) -> Mesh:
    """The mesh of a chart, u ``across`` times v ``along``, with the chart's own normals.

    A closed chart runs around in u and from pole to pole in v. ``du x dv`` points outwards.
    """
    low = POLE if closed else 0.0
    u, v = np.meshgrid(np.linspace(0.0, 1.0, across), np.linspace(low, 1.0 - low, along))
    du = chart(u + STEP, v) - chart(u - STEP, v)
    dv = chart(u, v + STEP) - chart(u, v - STEP)
    normal = np.cross(du, dv, axis=0)
    normal /= np.linalg.norm(normal, axis=0)
    corner = np.arange(across * along, dtype=np.int32).reshape(along, across)
    a, b, c, d = corner[:-1, :-1], corner[:-1, 1:], corner[1:, :-1], corner[1:, 1:]
    faces = np.concatenate([np.stack(t, axis=-1).reshape(-1, 3) for t in ((a, b, d), (a, d, c))])
    flat = [np.reshape(part, (3, -1)).T for part in (chart(u, v), normal)]
    return Mesh(flat[0], flat[1], np.stack([u.ravel(), v.ravel()], axis=1), faces)


def _around(u: Array, v: Array) -> Array:
    """Unit directions; v runs from the lower pole up, u around the y axis from the back."""
    turn, up = 2.0 * np.pi * (u + 0.5), np.pi * v
    return np.stack([np.sin(up) * np.sin(turn), -np.cos(up), np.sin(up) * np.cos(turn)])


def _waves(seed: int, count: int, length: float) -> Callable[[Array], Array]:
    """A smooth random function of points ``(d, ...)``: cosines, unit variance."""
    rng = np.random.default_rng(seed)
    waves = rng.normal(0.0, 1.0, (count, 3))
    waves *= length / np.linalg.norm(waves, axis=1, keepdims=True)
    phases = rng.uniform(0.0, 2.0 * np.pi, count)

    def value(points: Array) -> Array:
        turns = np.tensordot(waves[:, : len(points)], points, 1)
        phase = phases.reshape(-1, *([1] * (points.ndim - 1)))
        return np.asarray(np.sqrt(2.0 / count) * np.cos(turns + phase).sum(axis=0))

    return value


def bumpy_sphere() -> list[Mesh]:
    """A ball with round bumps."""
    bumps = _waves(3, 24, 11.0)

    def chart(u: Array, v: Array) -> Array:
        towards = _around(u, v)
        return np.asarray((0.82 + 0.022 * bumps(towards)) * towards)

    return [charted(chart, 500, 300, closed=True)]


def relief() -> list[Mesh]:
    """A deep relief with hollows: waves, a dome and three bowls."""
    rough = _waves(5, 20, 7.0)

    def bump(x: Array, y: Array, where: tuple[float, float], width: float) -> Array:
        return np.asarray(np.exp(-((x - where[0]) ** 2 + (y - where[1]) ** 2) / width**2))

    def chart(u: Array, v: Array) -> Array:
        x, y = 2.2 * u - 1.1, 2.2 * v - 1.1
        z = 0.045 * rough(np.stack([x, y])) + 0.35 * bump(x, y, (0.35, 0.3), 0.4)
        z -= 0.32 * bump(x, y, (-0.45, 0.35), 0.28) + 0.25 * bump(x, y, (0.45, -0.5), 0.25)
        return np.stack([x, y, z - 0.28 * bump(x, y, (-0.35, -0.45), 0.3)])

    return [charted(chart, 400, 400, closed=False)]


def vase() -> list[Mesh]:
    """A fluted vase with a narrow neck."""

    def chart(u: Array, v: Array) -> Array:
        turn, y = 2.0 * np.pi * (u + 0.5), 1.84 * v - 0.92
        radius = 0.42 + 0.24 * np.cos(3.1 * (y + 0.2)) + 0.10 * np.exp(-(((y - 0.95) / 0.18) ** 2))
        radius = radius * (1.0 + 0.025 * np.cos(16.0 * turn) * np.exp(-((y / 0.6) ** 4)))
        return np.stack([radius * np.sin(turn), y, radius * np.cos(turn)])

    return [charted(chart, 700, 300, closed=True)]


def bust() -> list[Mesh]:
    """A head with brow, nose, eye sockets and chin on a neck and shoulders."""
    features = (
        # x, y, z of the direction, height, width
        (0.00, -0.12, 1.0, 0.20, 0.16),
        (0.00, 0.28, 1.0, 0.06, 0.35),
        (0.33, 0.12, 1.0, -0.09, 0.17),
        (-0.33, 0.12, 1.0, -0.09, 0.17),
        (0.00, -0.42, 1.0, -0.05, 0.10),
        (0.00, -0.75, 1.0, 0.08, 0.25),
        (1.00, 0.00, 0.1, 0.09, 0.20),
        (-1.0, 0.00, 0.1, 0.09, 0.20),
    )

    def head(u: Array, v: Array) -> Array:
        towards = _around(u, v)
        radius = np.ones_like(towards[0])
        for x, y, z, height, width in features:
            place = np.array([x, y, z]) / np.linalg.norm([x, y, z])
            apart = 2.0 - 2.0 * np.tensordot(place, towards, 1)
            radius = radius + height * np.exp(-apart / width**2)
        shape = np.array([0.42, 0.55, 0.50]).reshape(3, *([1] * u.ndim))
        middle = np.array([0.0, 0.30, 0.0]).reshape(shape.shape)
        return np.asarray(shape * radius * towards + middle)

    def ball(sizes: tuple[float, float, float], place: tuple[float, float, float]) -> Chart:
        def chart(u: Array, v: Array) -> Array:
            ends = [np.reshape(part, (3, *([1] * u.ndim))) for part in (sizes, place)]
            return np.asarray(ends[0] * _around(u, v) + ends[1])

        return chart

    return [
        charted(head, 500, 400, closed=True),
        charted(ball((0.24, 0.45, 0.24), (0.0, -0.35, -0.05)), 200, 150, closed=True),
        charted(ball((0.85, 0.38, 0.40), (0.0, -0.90, -0.10)), 300, 200, closed=True),
    ]


SHAPES: dict[str, Callable[[], list[Mesh]]] = {
    "bumpy": bumpy_sphere,
    "relief": relief,
    "vase": vase,
    "bust": bust,
}
"""Meshes by name; the sphere is a shape of its own in the renderer."""


def panel(slope: float, pixels: int, finer: int = 3) -> tuple[Mesh, Array]:
    """A painted panel whose slopes have the given root mean square, in degrees, and its colours.

    Heights and colours ``(y, x, 3)`` are those of a simulated painting; heights run smoothly
    between its pixels (Fourier interpolation), and the relief ends level at the border. Colours are
    rendered upside down, so that edges of colours are not those of the relief.
    """
    painting = simulate.painting(7, (pixels, pixels), varnish=None, pitch_mm=0.4)
    height = painting.height.astype(np.float64)
    height -= height.mean()
    edge = np.clip(np.minimum(np.arange(pixels) + 0.5, pixels - 0.5 - np.arange(pixels)) / 3, 0, 1)
    height *= np.outer(edge, edge)
    waves = np.fft.fft2(height)
    frequency = np.fft.fftfreq(pixels)
    # A soft limit below the sampling frequency: a pixel does not hold a whole brush mark.
    waves *= np.exp(-((np.hypot(*np.meshgrid(frequency, frequency)) / 0.22) ** 2))
    fine, first = pixels * finer, pixels * (finer - 1) // 2
    padded = np.zeros((fine, fine), complex)
    padded[first : first + pixels, first : first + pixels] = np.fft.fftshift(waves)
    turns = np.fft.fftfreq(fine, 2.0 / fine) * 2.0 * np.pi
    waves = np.fft.ifftshift(padded) * finer**2
    z = np.fft.ifft2(waves).real
    right = np.fft.ifft2(1j * turns[None, :] * waves).real
    up = -np.fft.ifft2(1j * turns[:, None] * waves).real
    factor = np.tan(np.radians(slope)) / np.sqrt(np.mean(right**2 + up**2))
    z, right, up = factor * z, factor * right, factor * up
    place = (np.arange(fine) + 0.5 * finer) / (0.5 * fine) - 1.0
    x, y = np.meshgrid(place, -place)
    # Half a pixel is missing at two borders: the first row and column again, a period further.
    wrap = [np.pad(part, (1, 1), mode="wrap")[1:, 1:] for part in (z, right, up)]
    x, y = (np.pad(part, ((0, 1), (0, 1)), mode="edge") for part in (x, y))
    x[:, -1], y[-1, :] = place[-1] + 2.0 / fine, -place[-1] - 2.0 / fine
    z, right, up = wrap
    normal = np.stack([-right, -up, np.ones_like(z)])
    normal /= np.linalg.norm(normal, axis=0)
    side = fine + 1
    corner = np.arange(side * side, dtype=np.int32).reshape(side, side)
    a, b, c, d = corner[:-1, :-1], corner[:-1, 1:], corner[1:, :-1], corner[1:, 1:]
    faces = np.concatenate([np.stack(t, axis=-1).reshape(-1, 3) for t in ((a, c, d), (a, d, b))])
    points = np.stack([x.ravel(), y.ravel(), z.ravel()], axis=1)
    texture = 0.5 * (points[:, :2] + 1.0)
    mesh = Mesh(points, normal.reshape(3, -1).T, texture, faces)
    bands = painting.reflectance_in(simulate.camera("rgb"))
    colours = np.clip(np.moveaxis(bands, 0, -1), 0.02, 0.9)
    return mesh, np.asarray(colours, np.float64)
