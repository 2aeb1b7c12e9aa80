"""A flat scene, a lens and a camera in plain float64 numpy: photographs whose truth is known.

Inverse mapping: each pixel is divided into ``n x n`` squares; the middle of each is undistorted by
Newton's method, its ray meets the plane z = 0, and the scene is evaluated there in mm (x right, y
up). The mean of the squares is the light of the pixel. Whole numbers are the middles of pixels.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np


def distorted(x, y, k):
    """Brown's model at normalised coordinates; ``k``: k1, k2, p1, p2, k3."""
    k1, k2, p1, p2, k3 = k
    r2 = x**2 + y**2
    radial = 1 + k1 * r2 + k2 * r2**2 + k3 * r2**3
    return (
        x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x**2),
        y * radial + p1 * (r2 + 2 * y**2) + 2 * p2 * x * y,
    )


def undistorted(u, v, k):
    """Newton's method with a Jacobian by difference quotients."""
    x, y, h = u.copy(), v.copy(), 1e-6
    for _ in range(12):
        a, b = distorted(x, y, k)
        ax, bx = distorted(x + h, y, k)
        ay, by = distorted(x, y + h, k)
        j = (ax - a) / h, (ay - a) / h, (bx - b) / h, (by - b) / h
        det = j[0] * j[3] - j[1] * j[2]
        e, f = u - a, v - b
        step = (j[3] * e - j[1] * f) / det, (j[0] * f - j[2] * e) / det
        x, y = x + step[0], y + step[1]
        if max(np.abs(step[0]).max(), np.abs(step[1]).max()) < 1e-10:
            break
    return x, y


@lru_cache(maxsize=3)
def rays_of_pixels(size, focal, k, centre, n):
    """Undistorted coordinates of the ``n x n`` squares of all pixels: the same for all poses."""
    offsets = (np.arange(n) + 0.5) / n - 0.5
    columns, rows = np.meshgrid(np.arange(size[0], dtype=float), np.arange(size[1], dtype=float))
    return [
        undistorted((columns + dx - centre[0]) / focal, (rows + dy - centre[1]) / focal, k)
        for dy in offsets
        for dx in offsets
    ]


class Camera:
    """A pinhole camera with a lens that looks at the plane z = 0.

    ``tilt``: degrees between its axis and the normal of the plane, ``azimuth``: from which side
    (0: from the right), ``roll`` about its axis, ``distance`` in mm to ``aim`` on the plane.
    """

    def __init__(self, size, focal, k=(0, 0, 0, 0, 0), *, tilt=0.0, azimuth=0.0, roll=0.0,
                 distance=1000.0, aim=(0.0, 0.0), centre=None):  # fmt: skip
        self.size, self.focal, self.k = size, focal, k
        self.centre = ((size[0] - 1) / 2, (size[1] - 1) / 2) if centre is None else centre
        t, a, r = np.radians([tilt, azimuth, roll])
        back = np.array([np.sin(t) * np.cos(a), np.sin(t) * np.sin(a), np.cos(t)])
        self.place = np.array([*aim, 0.0]) + distance * back
        up = np.array([0.0, 1.0, 0.0]) - back[1] * back
        up /= np.linalg.norm(up)
        right = np.cross(up, back)
        # Rows of the image run down: the camera's axes are right, down, forward.
        self.axes = np.stack([
            np.cos(r) * right + np.sin(r) * up, np.sin(r) * right - np.cos(r) * up, -back
        ])  # fmt: skip

    def pixel(self, mm):
        """Where points ``(n, 2)`` of the plane are seen."""
        mm = np.asarray(mm, float)
        rays = (np.column_stack([mm, np.zeros(len(mm))]) - self.place) @ self.axes.T
        u, v = distorted(rays[:, 0] / rays[:, 2], rays[:, 1] / rays[:, 2], self.k)
        return np.column_stack([self.focal * u + self.centre[0], self.focal * v + self.centre[1]])

    def photograph(self, scene, n=4):
        """``(y, x)``: mean of ``scene(x_mm, y_mm)`` over the area of each pixel."""
        total = np.zeros(self.size[::-1])
        squares = rays_of_pixels(self.size, self.focal, tuple(self.k), self.centre, n)
        for x, y in squares:
            rays = [x * a + y * b + c for a, b, c in self.axes.T]
            reach = -self.place[2] / rays[2]
            total += scene(self.place[0] + reach * rays[0], self.place[1] + reach * rays[1])
        return total / n**2


def step(x, width):
    """A soft edge at 0: a Gaussian's integral to a part in 200, as a logistic curve."""
    return 1.0 / (1.0 + np.exp(np.clip(-1.702 * x / width, -60.0, 60.0)))


def chessboard(columns, rows, side, soft=0.2, low=0.1, high=0.9):
    """Squares about the middle, ``columns x rows`` of inner corners, on a bright ground.

    Edges are ``soft`` mm wide on both sides alike, so that squares of a pixel miss no part of them:
    hard ones would be off by up to half such a square.
    """

    def scene(x, y):
        i, j = x / side + (columns + 1) / 2, y / side + (rows + 1) / 2
        waves = []
        for place in (i, j):
            off = (place - np.round(place)) * side  # from the nearest edge
            sign = np.where(np.round(place) % 2, 1.0, -1.0)
            waves.append(sign * (2.0 * step(off, soft) - 1.0))
        inside = 1.0
        for place, count in ((i, columns + 1), (j, rows + 1)):
            inside = inside * step(place * side, soft) * step((count - place) * side, soft)
        value = low + (high - low) * 0.5 * (1.0 + waves[0] * waves[1])
        return high + inside * (value - high)

    return scene


def marker(bits, corner, side, soft=0.2, low=0.1, high=0.9):
    """A square marker: ``bits`` (n, n) of 0 and 1 with its border, upper left ``corner`` in mm.

    Returns a function of mm: what the marker adds to the bright ground.
    """
    n = len(bits)

    def scene(x, y):
        across, down = (x - corner[0]) / side * n, (corner[1] - y) / side * n
        total = np.zeros_like(x)
        near = (across > -2) & (across < n + 2) & (down > -2) & (down < n + 2)
        width = soft / side * n
        columns, rows = (
            [step(place - k, width) - step(place - k - 1, width) for k in range(n)]
            for place in (across[near], down[near])
        )
        dark = np.zeros(near.sum())
        for j in range(n):
            for i in range(n):
                if not bits[j, i]:
                    dark += rows[j] * columns[i]
        total[near] = (low - high) * dark
        return total

    return scene


def together(*scenes):
    """The sum of scenes: a ground and what is added to it."""
    return lambda x, y: sum(scene(x, y) for scene in scenes)


def framed(width, height, side, bits, soft=0.25):
    """Four markers, each touching a corner of a painting ``width x height`` mm; 0 to 3 clockwise.

    ``bits``: the code of each marker with its border.
    """
    scenes = []
    for code, (right, up) in zip(bits, ((-1, 1), (1, 1), (1, -1), (-1, -1)), strict=True):
        x, y = right * (width + side) / 2, up * (height + side) / 2
        scenes.append(marker(code, (x - side / 2, y + side / 2), side, soft))
    return together(*scenes)


def grid_of(columns, rows, side):
    """``(n, 2)`` mm: the inner corners of :func:`chessboard`, row by row from the upper left."""
    x = (np.arange(columns) - (columns - 1) / 2) * side
    y = ((rows - 1) / 2 - np.arange(rows)) * side
    return np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
