"""The relighting methods that impasto is compared with, in plain float64 numpy from their papers.

Each predicts photographs ``(held, ...)`` under new light directions from photographs
``(train, ...)`` under known ones. All but the robust Lambert fit are linear in the photographs, so
each is a matrix of weights ``(held, train)``.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from impasto.rig import Rig
from impasto.stack import Stack

Array: TypeAlias = NDArray[np.floating[Any]]
Weights: TypeAlias = Callable[[Array, Array], Array]


def fitted(basis: Callable[[Array], Array]) -> Weights:
    """Least squares on basis functions ``(obs, 3) -> (obs, terms)`` of the light direction."""
    return lambda train, held: basis(held) @ np.linalg.pinv(basis(train))


def polynomial(light: Array) -> Array:
    """Six terms of the polynomial texture map (Malzbender, Gelb & Wolters 2001, eq. 3)."""
    u, v = light[:, 0], light[:, 1]
    return np.stack([u * u, v * v, u * v, u, v, np.ones_like(u)], axis=1)


def hemispherical(light: Array) -> Array:
    """Nine hemispherical harmonics (Gautron, Krivanek, Pattanaik & Bouatouch 2004), to order 2."""
    cosine = np.clip(light[:, 2], np.cos(np.pi / 2 - 0.01), 1.0)
    azimuth = np.arctan2(light[:, 1], light[:, 0])
    x, sine = 2.0 * cosine - 1.0, 2.0 * np.sqrt(cosine - cosine**2)
    terms = [
        np.sqrt(1 / (2 * np.pi)) * np.ones_like(x),
        np.sqrt(3 / (2 * np.pi)) * sine * np.cos(azimuth),
        np.sqrt(3 / (2 * np.pi)) * x,
        np.sqrt(3 / (2 * np.pi)) * sine * np.sin(azimuth),
        np.sqrt(15 / (8 * np.pi)) * sine**2 * np.cos(2 * azimuth),
        np.sqrt(15 / (2 * np.pi)) * x * sine * np.cos(azimuth),
        np.sqrt(5 / (8 * np.pi)) * (3 * x**2 - 1),
        np.sqrt(15 / (2 * np.pi)) * x * sine * np.sin(azimuth),
        np.sqrt(15 / (8 * np.pi)) * sine**2 * np.sin(2 * azimuth),
    ]
    return np.stack(terms, axis=1)


def gaussian(train: Array, held: Array, sigma: float = 0.25) -> Array:
    """Normalised Gaussian weights ``exp(-|l - l_i|^2 / sigma^2)``, as relight's RBF has them.

    Ponchio, Corsini & Scopigno 2018, "A compact representation of relightable images".
    """
    squared = ((held[:, None] - train[None]) ** 2).sum(axis=2)
    weight = np.exp(-squared / sigma**2)
    return np.asarray(weight / weight.sum(axis=1, keepdims=True))


def thin_plate(train: Array, held: Array) -> Array:
    """Thin-plate splines with a linear trend over the unit sphere's directions (Duchon 1977).

    ``s(l) = sum_i w_i r_i^2 ln r_i + a + b . l``, through every photograph.
    """

    def kernel(a: Array, b: Array) -> Array:
        squared = ((a[:, None] - b[None]) ** 2).sum(axis=2)
        return np.asarray(0.5 * squared * np.log(np.where(squared > 0, squared, 1.0)))

    def trend(light: Array) -> Array:
        return np.column_stack([np.ones(len(light)), light])

    count = len(train)
    system = np.zeros((count + 4, count + 4))
    system[:count, :count] = kernel(train, train)
    system[:count, count:] = trend(train)
    system[count:, :count] = trend(train).T
    rows = np.hstack([kernel(held, train), trend(held)])
    return np.asarray(np.linalg.solve(system, rows.T).T[:, :count])


WEIGHTS: dict[str, Weights] = {
    "Lambert": fitted(lambda light: light),
    "PTM": fitted(polynomial),
    "HSH": fitted(hemispherical),
    "RBF, normalised Gaussian": gaussian,
    "RBF, thin plate": thin_plate,
}


def robust_lambert(train: Array, held: Array, linear: Array, steps: int = 10) -> Array:
    """Lambert's law on linear light ``(train, band, y, x)``, by least absolute residuals.

    One normal per pixel from the mean of the bands, by iteratively reweighted least squares, then
    each band's albedo with the same weights. Clipped samples (not finite) do not count.
    """
    usable = np.asarray(np.isfinite(linear).all(axis=1))
    linear = np.where(usable[:, None], linear, 0.0)
    grey = linear.mean(axis=1)
    weight = usable.astype(np.float64)
    for _ in range(steps):
        matrix = np.einsum("oyx,oi,oj->yxij", weight, train, train, optimize=True)
        right = np.einsum("oyx,oyx,oi->yxi", weight, grey, train, optimize=True)
        # A hundred-millionth of the trace keeps pixels without usable photographs solvable.
        ridge = 1e-8 * np.trace(matrix, axis1=2, axis2=3) + 1e-30
        vector = np.linalg.solve(matrix + ridge[..., None, None] * np.eye(3), right[..., None])
        shading = np.maximum(np.einsum("oi,yxi->oyx", train, vector[..., 0]), 0.0)
        residual = np.abs(grey - shading)
        floor = 1e-3 * np.median(residual, axis=0) + 1e-12
        weight = usable / np.maximum(residual, floor)
    norm = np.linalg.norm(vector[..., 0], axis=2) + 1e-30
    cosine = shading / norm
    energy = (weight * cosine**2).sum(axis=0) + 1e-30
    albedo = np.einsum("oyx,obyx,oyx->byx", weight, linear, cosine, optimize=True) / energy
    normal = np.moveaxis(vector[..., 0], 2, 0) / norm
    return np.asarray(np.maximum(np.einsum("oi,iyx->oyx", held, normal), 0.0)[:, None] * albedo)


@dataclass(frozen=True, eq=False)
class Interpolation:
    """What a method of this file makes of a stack: it knows no normals, and leaves no pixel out."""

    weights: Weights
    train: Array
    samples: Array
    normal: None = None

    @property
    def status(self) -> NDArray[np.uint8]:
        """``(y, x)``, all fitted."""
        return np.zeros(self.samples.shape[2:], np.uint8)

    def predict(self, lights: Rig) -> Array:
        """``(obs, band, y, x)``."""
        weights = self.weights(self.train, lights.directions) * lights.intensities[:, None]
        shown = weights @ self.samples.reshape(len(self.samples), -1)
        return np.asarray(shown.reshape(len(weights), *self.samples.shape[1:]))


def light_of(stack: Stack) -> Array:
    """``(obs, band, y, x)`` per unit of intensity; clipped samples are full scale."""
    full = (np.asarray(stack.saturation) - stack.black) * stack.scale
    light = np.array([stack.linear(i) for i in range(len(stack.rig))], np.float32)
    clipped = np.minimum(light, full[:, None, None].astype(np.float32))
    return np.asarray(clipped / stack.rig.intensities[:, None, None, None].astype(np.float32))


def _peer(weights: Weights) -> Callable[[Stack, int | None], Interpolation]:
    def fit(stack: Stack, threads: int | None) -> Interpolation:
        del threads
        shown = Interpolation(weights, stack.rig.directions, light_of(stack))
        # What interpolates has nothing to fit: it costs what it takes to show one photograph.
        shown.predict(stack.rig.take([0]))
        return shown

    return fit


PEERS = {name: _peer(weights) for name, weights in WEIGHTS.items() if name != "Lambert"}
"""Fits ``(stack, threads)`` by name."""
