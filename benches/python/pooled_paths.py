"""Paths of pixels under one lobe, in plain numpy: how long their steps are, and where they start.

    python benches/python/pooled_paths.py [--size 64] [--record]

Double precision, from the equations of docs/models.md ("One lobe"), without the code of the fit:
iteratively reweighted least squares on the M-scale, with steps as they are and relaxed. *Steps* are
those until one changes the squared scale by less than a thousandth, 16 at most, from the normals of
photometric stereo. *Normal* is the mean error in degrees: from there, then with restarts at the
facet that mirrors the brightest photograph, then with restarts at the normal that faces the viewer,
too, the smallest scale winning; *scale* is what the last ones do to the geometric mean of the
squared scale, as a ratio.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from record import run_info, show, write

import impasto
from impasto import simulate
from study.data_sets import dome

Floats = NDArray[np.float64]

SCENES = {
    "patches, 48 lights": (4, "patches", 1.0, 48),
    "patches, relief, 48 lights": (6, "patches", 2.0, 48),
    "satin, relief, 24 lights": (7, "satin", 2.5, 24),
    "satin, 16 lights": (10, "satin", 1.5, 16),
    "gloss, 48 lights": (8, "gloss", 1.0, 48),
    "matte, 24 lights": (9, "matte", 1.0, 24),
}
INDEX = 1.45
VIEW = np.array([0.0, 0.0, 1.0])
MOST, TOLERANCE, LONGEST, RIDGE = 16, 1e-3, 0.1, 1e-3
CURVATURE = 0.733206227
"""Of the scale under normal noise in three bands, which the test of
crates/impasto/src/sbrdf/pooled/scale.rs has from SciPy."""
RELAXATION = 2.0 / (1.0 + CURVATURE)


@dataclass
class Place:
    """Where pixels stand, and what they leave there."""

    normal: Floats
    colours: Floats
    residuals: Floats
    squares: Floats
    scale: Floats


class Pixels:
    """Samples ``(n, obs, band)`` of pixels under distant lights and one lobe."""

    def __init__(self, stack: impasto.Stack, beta: float, gamma: float) -> None:
        linear = np.array([stack.linear(i) for i in range(len(stack.rig))], dtype=np.float64)
        self.samples = np.moveaxis(linear.reshape(*linear.shape[:2], -1), -1, 0)
        self.usable = np.isfinite(self.samples).all(axis=2)
        self.samples = np.where(self.usable[..., None], self.samples, 0.0)
        self.lights = stack.rig.directions
        self.beta, self.sharpness = beta, np.log(2.0) / gamma**2
        half = self.lights + VIEW
        self.half = half / np.linalg.norm(half, axis=1, keepdims=True)
        cosine = self.half @ VIEW
        q = np.sqrt(INDEX**2 - 1.0 + cosine**2)
        across = (q - cosine) / (q + cosine)
        along = (cosine * (q + cosine) - 1.0) / (cosine * (q - cosine) + 1.0)
        self.fresnel, self.v_h = 0.5 * across**2 * (1.0 + along**2), cosine
        light = np.maximum(self.samples.sum(axis=2), 0.0)
        mean = light.sum(axis=1, keepdims=True) / self.usable.sum(axis=1, keepdims=True)
        self.precision = mean / (light + 0.1 * mean)

    def specular(self, normal: Floats) -> Floats:
        n_l, n_v, n_h = normal @ self.lights.T, (normal @ VIEW)[:, None], normal @ self.half.T
        masked = 2.0 * n_h / self.v_h
        attenuation = np.minimum(np.minimum(masked, 1.0 / n_v), masked * n_l / n_v)
        chord = np.linalg.norm(normal[:, None] - self.half, axis=2)
        phi = 2.0 * np.arcsin(np.minimum(0.5 * chord, 1.0))
        lobe = self.beta * self.fresnel * attenuation * np.exp(-self.sharpness * phi**2)
        return np.where((n_l > 0.0) & (n_v > 0.0), lobe, 0.0)

    def scale(self, squares: Floats) -> Floats:
        """Squared M-scales: a quarter is the mean of ``v / (1 + v)``, by bisection."""
        usable = self.usable.sum(axis=1)
        low, high = np.full(len(squares), -46.0), np.log(squares.max(axis=1) * 4.0 + 1e-20)
        for _ in range(60):
            middle = 0.5 * (low + high)
            rho = squares / (squares + np.exp(middle)[:, None])
            above = rho.sum(axis=1) > 0.25 * usable
            low, high = np.where(above, middle, low), np.where(above, high, middle)
        return np.exp(0.5 * (low + high))

    def visit(self, normal: Floats, colours: Floats) -> Place:
        cosine = np.maximum(normal @ self.lights.T, 0.0)
        predicted = cosine[..., None] * colours[:, None] + self.specular(normal)[..., None]
        residuals = np.where(self.usable[..., None], self.samples - predicted, 0.0)
        squares = (residuals**2).mean(axis=2) * self.precision
        return Place(normal, colours, residuals, squares, self.scale(squares))

    def step(self, at: Place) -> tuple[Floats, Floats]:
        """The step under fixed weights: of the normal in its plane, and of the colours."""
        frame = tangents(at.normal)
        cosine = np.maximum(at.normal @ self.lights.T, 0.0)
        here, by = self.specular(at.normal), 1e-5
        slopes = []
        for direction in frame:
            moved = (self.specular(unit(at.normal + by * direction)) - here) / by
            diffuse = (direction @ self.lights.T) * (cosine > 0.0)
            slopes.append(diffuse[..., None] * at.colours[:, None] + moved[..., None])
        jacobian = np.stack(slopes, axis=-1)
        fit = at.scale[:, None] / (at.squares + at.scale[:, None])
        weight = np.where(self.usable, fit**2, 0.0) * self.precision
        own = np.maximum((weight * cosine**2).sum(axis=1), 1e-300)
        heavy = weight * cosine
        matrix = np.einsum("po,pobi,pobj->pij", weight, jacobian, jacobian)
        pull = np.einsum("po,pobi,pob->pi", weight, jacobian, at.residuals)
        mixed = np.einsum("po,pobi->pbi", heavy, jacobian)
        coloured = np.einsum("po,pob->pb", heavy, at.residuals)
        matrix -= np.einsum("pbi,pbj->pij", mixed, mixed) / own[:, None, None]
        pull -= np.einsum("pbi,pb->pi", mixed, coloured) / own[:, None]
        matrix[:, [0, 1], [0, 1]] *= 1.0 + RIDGE
        tilt = np.linalg.solve(matrix, pull[..., None])[..., 0]
        length = np.linalg.norm(tilt, axis=1, keepdims=True)
        tilt *= np.minimum(1.0, LONGEST / RELAXATION / np.maximum(length, 1e-300))
        change = (coloured - np.einsum("pbi,pi->pb", mixed, tilt)) / own[:, None]
        return tilt[:, :1] * frame[0] + tilt[:, 1:] * frame[1], change

    def path(
        self, normal: Floats, colours: Floats, relaxation: float
    ) -> tuple[Place, NDArray[np.int_]]:
        """Where paths end, and their steps."""
        best = self.visit(normal, colours)
        active = np.ones(len(normal), np.bool_)
        steps = np.zeros(len(normal), np.int_)
        turn, change = self.step(best)
        for _ in range(MOST):
            if not active.any():
                break
            steps += active
            trial = self.visit(
                unit(best.normal + relaxation * turn),
                np.maximum(best.colours + relaxation * change, 0.0),
            )
            better = active & (trial.scale < best.scale)
            ended = np.abs(trial.scale / best.scale - 1.0) < TOLERANCE
            for name in ("normal", "colours", "residuals", "squares", "scale"):
                old, new = getattr(best, name), getattr(trial, name)
                mask = better.reshape(-1, *[1] * (old.ndim - 1))
                setattr(best, name, np.where(mask, new, old))
            fresh = self.step(best)
            turn = np.where(better[:, None], fresh[0], 0.25 * turn)
            change = np.where(better[:, None], fresh[1], 0.25 * change)
            active &= ~ended
        return best, steps


def unit(vectors: Floats) -> Floats:
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def tangents(normal: Floats) -> tuple[Floats, Floats]:
    first = unit(np.cross(normal, [0.0, 1.0, 0.0]))
    return first, np.cross(normal, first)


def degrees(normal: Floats, truth: Floats) -> float:
    chord = np.linalg.norm(normal - truth, axis=1)
    return float(np.degrees(2.0 * np.arcsin(0.5 * chord)).mean())


def row(name: str, size: int) -> dict[str, Any]:
    seed, varnish, relief, lights = SCENES[name]
    painting = simulate.painting(seed, (size, size), varnish=varnish, relief=relief)
    taken = simulate.capture(painting, impasto.Rig(dome(lights)), "rgb", model="torrance-sparrow")
    common = impasto.fit_sbrdf(taken.stack, pooling="painting", refine=False)
    stereo = impasto.fit_normals(taken.stack)
    pixels = Pixels(taken.stack, common.beta, common.gamma)
    maps = (stereo.normal, stereo.albedo, taken.truth.normal)
    start, colours, truth = (np.float64(m).reshape(len(m), -1).T for m in maps)
    _, plain = pixels.path(start, colours, 1.0)
    first, relaxed = pixels.path(start, colours, RELAXATION)
    found: dict[str, Any] = {
        "scene": name, "steps": float(plain.mean()), "relaxed": float(relaxed.mean()),
        "stereo": degrees(start, truth), "first": degrees(first.normal, truth),
    }  # fmt: skip
    brightest = pixels.half[pixels.samples.sum(axis=2).argmax(axis=1)]
    normal, scale, colours = first.normal, first.scale, first.colours
    for key, begin in (("brightest", brightest), ("facing", np.tile(VIEW, (len(start), 1)))):
        other, _ = pixels.path(begin, colours, RELAXATION)
        before, better = scale, other.scale < scale
        normal = np.where(better[:, None], other.normal, normal)
        colours = np.where(better[:, None], other.colours, colours)
        scale = np.where(better, other.scale, scale)
        found[key] = degrees(normal, truth)
        found["scale"] = float(np.exp(np.log(scale / before).mean()))
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--size", type=int, default=64)
    parser.add_argument("--record", action="store_true")
    options = parser.parse_args()
    rows = [row(name, options.size) for name in SCENES]
    show("Steps of a path, and mean errors of normals in degrees", rows)
    if options.record:
        command = "python benches/python/pooled_paths.py --record"
        write("pooled_paths.json", {"run": run_info(command), "rows": rows})


if __name__ == "__main__":
    main()
