"""Measured materials, by models richer than any that is fitted here, in plain float64 numpy.

Shifted gamma: Bagher, Soler and Holzschuch 2012, eq. 10 to 13; ABC: Low, Kronander, Ynnerman and
Unger 2012, eq. 8. Both are fits to the same hundred measured materials; the tables are not part of
impasto (``sgd_100.csv`` and ``abc_100.csv``). This file shares nothing with the numerics that are
judged by it: all it has in common with them is the rig.
"""

from __future__ import annotations

import csv
from collections.abc import Callable
from pathlib import Path
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from impasto.errors import CorruptInputError
from impasto.lights import PointLight
from impasto.rig import Rig
from impasto.simulate.photographs import Forward

Array: TypeAlias = NDArray[np.float64]
Row: TypeAlias = dict[str, Array | float]
Reflect: TypeAlias = Callable[[Row, Array, Array, Array, Array], Array]
"""``pi f`` ``(band, pixel)`` from a row and the cosines N.L, N.V, N.H, L.H of some pixels."""

MATERIALS = (
    "special-walnut-224", "dark-blue-paint", "dark-red-paint", "green-latex", "purple-paint",
    "fruitwood-241", "orange-paint", "light-red-paint", "yellow-paint", "yellow-matte-plastic",
    "white-paint", "white-fabric",
)  # fmt: skip
"""Materials of the study: seven paints, two varnished woods and three others, darkest first."""


def read_materials(path: Path) -> dict[str, Row]:
    """Rows of a table by material; ``name_r``, ``name_g``, ``name_b`` become one array ``name``.

    Raises
    ------
    CorruptInputError
        It is no such table.
    """
    try:
        with path.open(newline="", encoding="utf-8") as file:
            lines = csv.DictReader(file, restkey="beyond the last column", strict=True)
            return {line["material"]: _row(line) for line in lines}
    except (KeyError, TypeError, ValueError, csv.Error) as error:
        problem = f"no table of materials ({type(error).__name__}: {error})"
        raise CorruptInputError(path, problem) from error


def _row(line: dict[str, str]) -> Row:
    row: Row = {}
    for column, text in line.items():
        if column == "material":
            continue
        name, _, channel = column.rpartition("_")
        if name and channel == "r":
            row[name] = np.array([float(line[f"{name}_{c}"]) for c in "rgb"])
        elif not name or channel not in "gb":
            row[column] = float(text)
    return row


def shifted_gamma(row: Row, n_l: Array, n_v: Array, n_h: Array, l_h: Array) -> Array:
    """Bagher et al. 2012: shifted gamma distribution of facets with its own shadowing."""
    p = {name: np.asarray(value)[:, None] for name, value in row.items()}
    tan2 = 1.0 / (n_h * n_h) - 1.0
    a = p["alpha"] + tan2 / p["alpha"]
    facets = p["kap"] * np.exp(-a) / (np.pi * a ** p["p"] * n_h**4)
    fresnel = np.maximum(p["f0"] - p["f1"] * l_h + (1.0 - l_h) ** 5 * (1.0 - p["f0"]), 0.0)

    def shadowing(cosine: Array) -> Array:
        theta = np.maximum(np.arccos(np.minimum(cosine, 1.0)) - p["theta0"], 0.0)
        # Beyond 700 the exponential overflows; its factor is clipped to 0 there.
        bend = np.minimum(p["c"] * theta ** p["k"], 700.0)
        return np.asarray(np.clip(1.0 + p["lambda"] * (1.0 - np.exp(bend)), 0.0, 1.0))

    specular = fresnel * facets * shadowing(n_l) * shadowing(n_v) / (n_l * n_v)
    return np.asarray(p["rho_d"] + p["rho_s"] * specular)


def abc(row: Row, n_l: Array, n_v: Array, n_h: Array, l_h: Array) -> Array:
    """Löw et al. 2012: ABC distribution of facets, V-grooves, exact dielectric Fresnel term."""
    facets = np.asarray(row["a"])[:, None] / (1.0 + float(row["b"]) * (1.0 - n_h)) ** float(
        row["c"]
    )
    g = np.sqrt(float(row["ior"]) ** 2 - 1.0 + l_h * l_h)
    ratio = (l_h * (g + l_h) - 1.0) / (l_h * (g - l_h) + 1.0)
    fresnel = 0.5 * ((g - l_h) / (g + l_h)) ** 2 * (1.0 + ratio**2)
    grooves = np.minimum(1.0, np.minimum(2.0 * n_h * n_v / l_h, 2.0 * n_h * n_l / l_h))
    specular = facets * fresnel * grooves / (n_l * n_v)
    return np.asarray(np.asarray(row["kd"])[:, None] + specular)


MODELS: dict[str, tuple[str, Reflect]] = {
    "shifted gamma": ("sgd_100.csv", shifted_gamma),
    "ABC": ("abc_100.csv", abc),
}


def forward_of(folder: Path, model: str) -> Forward:
    """A forward model for :func:`impasto.simulate.capture`: a painting in measured materials.

    A pixel is of the material whose place among :data:`MATERIALS` is that of the pixel's lightness
    among the pixels; beta and gamma of the simulated varnish play no part.

    Parameters
    ----------
    folder
        Where the tables lie.
    model
        ``"shifted gamma"`` or ``"ABC"``.

    Raises
    ------
    CorruptInputError
        The table is none, or lacks a material or a number of one.
    """
    file, reflect = MODELS[model]
    rows = read_materials(folder / file)
    for name in MATERIALS:
        try:
            seen = reflect(rows[name], *np.full((4, 1), 0.9))
        except KeyError as error:
            raise CorruptInputError(folder / file, f"lacks {error}") from error
        except TypeError as error:
            raise CorruptInputError(folder / file, f"{name}: {error}") from error
        if not np.isfinite(seen).all():
            raise CorruptInputError(folder / file, f"{name} has numbers that reflect no light")

    def forward(
        normal: NDArray[np.float32],
        diffuse: NDArray[np.float32],
        beta: NDArray[np.float32],
        gamma: NDArray[np.float32],
        rig: Rig,
    ) -> Array:
        del beta, gamma
        n = normal.astype(np.float64).reshape(3, -1)
        lightness = diffuse.astype(np.float64).mean(axis=0).ravel()
        place = np.argsort(np.argsort(lightness, kind="stable"), kind="stable")
        of_pixel = place * len(MATERIALS) // lightness.size
        out = np.zeros((len(rig), 3, n.shape[1]))
        for image, light, view in zip(out, rig.lights, rig.views, strict=True):
            if isinstance(light, PointLight):
                raise TypeError("measured materials are photographed under distant lights")
            l, v = np.asarray(light.direction), np.asarray(view)  # noqa: E741
            half = (l + v) / np.linalg.norm(l + v)
            n_l, n_v, n_h = l @ n, v @ n, half @ n
            lit = (n_l > 1e-6) & (n_v > 1e-6)
            for number, name in enumerate(MATERIALS):
                here = np.flatnonzero(lit & (of_pixel == number))
                angles = (n_l[here], n_v[here], n_h[here], np.full(here.size, l @ half))
                image[:, here] = light.intensity * n_l[here] * reflect(rows[name], *angles)
        return out.reshape(len(rig), 3, *normal.shape[1:])

    return forward
