"""Renderers to compare with: numpy in single precision, and Mitsuba 3, for ``side_by_side.py``.

Both show a painting ``maps`` from the front under one distant light as sRGB codes of 8 bits
``(y, x, 3)``. The maps are float32: ``normal`` and ``diffuse`` ``(3, y, x)``; ``beta`` and
``gamma`` ``(coat, y, x)``; or ``strength``, ``cxy``, ``cz`` and ``exponent`` ``(lobe, y, x)``.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray
from record import ROOT

sys.path.insert(1, str(ROOT / "tests"))

Maps: TypeAlias = dict[str, NDArray[np.float32]]
Codes: TypeAlias = NDArray[np.uint8]
Frame: TypeAlias = Callable[[], Codes]

INDEX = 1.45
LEVELS = 65535
"""Of the table of codes: 20 per code where codes lie closest."""


def numpy_frame(maps: Maps, light: Any, exposure: float) -> Frame:
    """The papers' equations in numpy, as one writes them: whole arrays, step by step."""
    direction = np.asarray(light, np.float32) / np.float32(np.linalg.norm(light))
    view = np.array((0.0, 0.0, 1.0), np.float32)
    half = (direction + view) / np.linalg.norm(direction + view)
    v_h = float(view @ half)

    def frame() -> Codes:
        normal = maps["normal"]
        n_l = np.maximum(np.tensordot(direction, normal, 1), 0.0)
        n_v = np.tensordot(view, normal, 1)
        shown = maps["diffuse"] * n_l
        if "beta" in maps:
            n_h = np.tensordot(half, normal, 1)
            phi = np.arccos(np.minimum(n_h, 1.0))
            masking = np.minimum(1.0, 2.0 * n_h * np.minimum(n_v, n_l) / v_h)
            for beta, gamma in zip(maps["beta"], maps["gamma"], strict=True):
                facets = np.exp(-np.float32(np.log(2.0)) * (phi / gamma) ** 2)
                shown += beta * facets * fresnel(v_h) * masking / n_v
        elif "exponent" in maps:
            upright = n_l * n_v
            flat = direction[2] - upright
            lobes = (maps[name] for name in ("strength", "cxy", "cz", "exponent"))
            for strength, cxy, cz, exponent in zip(*lobes, strict=True):
                base = np.maximum(cxy * flat + cz * upright, 0.0)
                shown += strength * base**exponent * n_l
        linear = np.clip(exposure * shown, 0.0, 1.0)
        curve = 1.055 * linear ** np.float32(1.0 / 2.4) - 0.055
        codes = np.where(linear <= 0.0031308, 12.92 * linear, curve)
        return np.ascontiguousarray(np.moveaxis((255.0 * codes + 0.5).astype(np.uint8), 0, -1))

    return frame


class TunedNumpy:
    """The same for speed.

    Every operation writes into an array that exists, what a light and a view have in common for all
    pixels is a number, a view from the front makes N.V the normal's z, and codes are looked up.
    So many ``rows`` at a time stay in the cache; ``threads`` share them (numpy lets others run
    while it computes).
    """

    def __init__(self, maps: Maps, light: Any, exposure: float, rows: int, threads: int) -> None:
        _, height, width = maps["normal"].shape
        self.maps = maps
        self.light = np.asarray(light, np.float64) / np.linalg.norm(light)
        self.codes = np.empty((height, width, 3), np.uint8)
        self.table = CodeTable(exposure)
        self.bands = list(pairwise([*range(0, height, rows), height]))
        self.scratch = [np.empty((7, rows, width), np.float32) for _ in range(threads)]
        self.index = [np.empty((rows, width), np.uint16) for _ in range(threads)]
        self.pool = ThreadPoolExecutor(threads)
        half = self.light + np.array((0.0, 0.0, 1.0))
        self.half = half / np.linalg.norm(half)

    def __call__(self) -> Codes:
        list(self.pool.map(self._share, range(len(self.scratch))))
        return self.codes

    def _share(self, worker: int) -> None:
        for first, last in self.bands[worker :: len(self.scratch)]:
            self._band(worker, slice(first, last))

    def _band(self, worker: int, rows: slice) -> None:
        maps = {name: plane[:, rows] for name, plane in self.maps.items()}
        count = maps["normal"].shape[1]
        lit, gloss, *spare = self.scratch[worker][:, :count]
        nx, ny, nz = maps["normal"]
        dot(nx, ny, nz, self.light, lit, spare[0])
        np.maximum(lit, 0.0, out=lit)
        shown = None
        if "beta" in maps:
            shown = self._torrance_sparrow(maps, lit, gloss, spare)
        elif "exponent" in maps:
            shown = self._lafortune(maps, lit, gloss, spare)
        value, index = spare[0], self.index[worker][:count]
        for band, diffuse in enumerate(maps["diffuse"]):
            np.multiply(diffuse, lit, out=value)
            if shown is not None:
                np.add(value, shown, out=value)
            np.minimum(value, 1.0 / self.table.exposure, out=value)
            np.multiply(value, LEVELS * self.table.exposure, out=value)
            np.add(value, 0.5, out=value)
            np.copyto(index, value, casting="unsafe")
            self.codes[rows, :, band] = self.table.codes[index]

    def _torrance_sparrow(self, maps: Maps, lit: Any, gloss: Any, spare: list[Any]) -> Any:
        nx, ny, nz = maps["normal"]
        n_h, other, squared, weight, lobe = spare
        v_h = float(self.half[2])
        dot(nx, ny, nz, self.half, n_h, other)
        # G / (N.V) = min(1 / (N.V), 2 (N.H) / (V.H), 2 (N.H) (N.L) / ((V.H) (N.V)))
        np.multiply(n_h, 2.0 / v_h, out=other)
        np.divide(lit, nz, out=weight)
        np.multiply(weight, other, out=weight)
        np.minimum(weight, other, out=weight)
        np.divide(1.0, nz, out=other)
        np.minimum(weight, other, out=weight)
        np.multiply(weight, fresnel(v_h), out=weight)
        np.minimum(n_h, 1.0, out=n_h)
        np.arccos(n_h, out=squared)
        np.multiply(squared, squared, out=squared)
        np.multiply(squared, -np.log(2.0), out=squared)
        for coat, (beta, gamma) in enumerate(zip(maps["beta"], maps["gamma"], strict=True)):
            np.multiply(gamma, gamma, out=lobe)
            np.divide(squared, lobe, out=lobe)
            np.exp(lobe, out=lobe)
            np.multiply(lobe, beta, out=lobe if coat else gloss)
            if coat:
                np.add(gloss, lobe, out=gloss)
        return np.multiply(gloss, weight, out=gloss)

    def _lafortune(self, maps: Maps, lit: Any, gloss: Any, spare: list[Any]) -> Any:
        upright, flat, base, other, _ = spare
        np.multiply(lit, maps["normal"][2], out=upright)
        np.subtract(float(self.light[2]), upright, out=flat)
        lobes = (maps[name] for name in ("strength", "cxy", "cz", "exponent"))
        for lobe, (strength, cxy, cz, exponent) in enumerate(zip(*lobes, strict=True)):
            np.multiply(cxy, flat, out=base)
            np.multiply(cz, upright, out=other)
            np.add(base, other, out=base)
            np.maximum(base, 1e-30, out=base)
            np.log(base, out=base)
            np.multiply(base, exponent, out=base)
            np.exp(base, out=base)
            np.multiply(base, strength, out=base if lobe else gloss)
            if lobe:
                np.add(gloss, base, out=gloss)
        return np.multiply(gloss, lit, out=gloss)


class CodeTable:
    """A table of codes of light times ``exposure``."""

    def __init__(self, exposure: float) -> None:
        linear = np.arange(LEVELS + 1) / LEVELS
        curve = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1.0 / 2.4) - 0.055)
        self.exposure = exposure
        self.codes = np.round(255.0 * curve).astype(np.uint8)


def dot(x: Any, y: Any, z: Any, direction: Any, out: Any, spare: Any) -> None:
    """Products of all normals with one direction."""
    np.multiply(x, float(direction[0]), out=out)
    np.multiply(y, float(direction[1]), out=spare)
    np.add(out, spare, out=out)
    np.multiply(z, float(direction[2]), out=spare)
    np.add(out, spare, out=out)


def fresnel(c: float) -> float:
    """Reflectance of a dielectric of index 1.45 at the cosine ``c``."""
    q = float(np.sqrt(INDEX**2 + c * c - 1.0))
    ratio = (c * (q + c) - 1.0) / (c * (q - c) + 1.0)
    return 0.5 * ((q - c) / (q + c)) ** 2 * (1.0 + ratio**2)


def mitsuba(threads: int) -> tuple[Any, dict[str, str]]:
    """Mitsuba 3 as it compiles its kernels for the CPU, and its versions."""
    from oracles import mitsuba_models as models

    mi = models.use("llvm_ad_rgb")
    models.dr.set_thread_count(threads)
    # What DRJIT_LIBLLVM_PATH names, without its folder.
    library = Path(os.environ.get("DRJIT_LIBLLVM_PATH", "libLLVM.so")).name
    return models, {"mitsuba": mi.__version__, "libLLVM": library}


def mitsuba_frame(
    models: Any, maps: Maps, light: Any, exposure: float, bsdf: str = "papers"
) -> Frame:
    """A scene that is loaded once; every call renders it.

    ``bsdf``: ``"papers"`` has the papers' model, ``diffuse`` of Mitsuba or one of
    ``tests/oracles/mitsuba_models.py``; ``"roughplastic"`` Mitsuba's own varnish, Beckmann facets
    of one roughness over a diffuse base.
    """
    mi, dr = models.mi, models.dr
    diffuse = maps["diffuse"]
    if bsdf == "roughplastic":
        # exp(-ln 2 phi^2 / gamma^2) and exp(-tan^2 phi / alpha^2)
        alpha = float(maps["gamma"].mean() / np.sqrt(np.log(2.0)))
        made = {
            "type": "roughplastic", "distribution": "beckmann", "alpha": alpha,
            "int_ior": INDEX, "ext_ior": 1.0, "diffuse_reflectance": models.bitmap(diffuse),
        }  # fmt: skip
    elif "beta" in maps:
        made = models.torrance_sparrow(diffuse, maps["beta"], maps["gamma"])
    elif "exponent" in maps:
        coloured = np.repeat(maps["strength"][:, None], 3, axis=1)
        shape = (maps[name] for name in ("cxy", "cz", "exponent"))
        made = models.lafortune(diffuse, coloured, *shape)
    else:
        made = models.diffuse(diffuse)
    size = diffuse.shape[1:]
    lamp = models.distant(light, exposure)
    scene = models.scene(models.with_normals(made, maps["normal"]), size, 1.0, [lamp])

    def frame() -> Codes:
        # In one kernel with the picture; ten times as fast as Bitmap.convert.
        x = dr.clip(mi.render(scene, spp=1).array, 0.0, 1.0)
        curve = dr.fma(1.055, dr.power(x, 1.0 / 2.4), -0.055)
        codes = dr.fma(dr.select(x <= 0.0031308, 12.92 * x, curve), 255.0, 0.5)
        return np.array(dr.llvm.UInt8(codes)).reshape(*size, 3)

    return frame
