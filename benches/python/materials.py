"""A hundred measured materials under many lights, by a model that impasto does not fit.

The shifted-gamma reflectances of Bagher, Soler and Holzschuch (2012), eq. 12 to 14, with the
parameters that they published for the MERL materials (``brdf/sgd_100.csv`` of the data folder): a
distribution of facets with a tail, a Fresnel term and a shadowing function of its own per band.
"""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np

SEED = 1
NORMALS = 200
"""Per material, as far as 60 degrees from the view."""
NOISE, BITS = 0.002, 12
"""Standard deviation relative to the clipping level; bits per sample."""
CLIPPED = 0.01
"""Share of the photographs' pixels that the exposure of each material clips."""
NAMES = ["rho_d", "rho_s", "alpha", "p", "f0", "f1", "kap", "lambda", "c", "k", "theta0"]


def materials(data: Path) -> dict[str, np.ndarray]:
    """Parameters ``(material, band)``."""
    with (data / "brdf" / "sgd_100.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    return {n: np.array([[float(row[f"{n}_{c}"]) for c in "rgb"] for row in rows]) for n in NAMES}


def radiance(
    p: dict[str, np.ndarray], band: int, lights: np.ndarray, normals: np.ndarray
) -> np.ndarray:
    """``(obs, material, normal)`` relative to a white board, seen from above."""
    half = lights + np.array([0.0, 0.0, 1.0])
    half /= np.linalg.norm(half, axis=1, keepdims=True)
    incidence, tilt = (lights @ normals.T)[:, None], (half @ normals.T)[:, None]
    view, difference = normals[:, 2], half[:, 2, None, None]
    q = {name: value[:, band, None] for name, value in p.items()}

    def shadowing(cosine: np.ndarray) -> np.ndarray:
        angle = np.arccos(np.clip(cosine, -1.0, 1.0))
        beyond = np.maximum(angle - q["theta0"], 0.0) ** q["k"]
        fall = -np.expm1(np.minimum(q["c"] * beyond, 500.0))
        return np.clip(1.0 + q["lambda"] * fall, 0.0, 1.0)

    safe = np.maximum(tilt, 1e-6) ** 2
    shifted = q["alpha"] + (1.0 / safe - 1.0) / q["alpha"]
    facets = q["kap"] * np.exp(-shifted) / (np.pi * shifted ** q["p"] * safe**2)
    fresnel = q["f0"] - q["f1"] * difference + (1.0 - difference) ** 5 * (1.0 - q["f0"])
    specular = q["rho_s"] * fresnel * facets * shadowing(incidence) * shadowing(view)
    lit = (incidence > 0.0) & (tilt > 0.0)
    return np.where(lit, q["rho_d"] * incidence + specular / view, 0.0)


def photographs(data: Path, lights: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Samples ``(obs, band, material, normal)``, clipped at 1, and normals ``(3, 1, normal)``."""
    rng = np.random.default_rng(SEED)
    height = rng.uniform(0.5, 1.0, NORMALS)
    turn, side = rng.uniform(0.0, 2.0 * np.pi, NORMALS), np.sqrt(1.0 - height**2)
    normals = np.stack([side * np.cos(turn), side * np.sin(turn), height], axis=1)
    p = materials(data)
    light = np.stack([radiance(p, band, lights, normals) for band in range(3)], axis=1)
    light /= np.quantile(light.max(axis=1), 1.0 - CLIPPED, axis=(0, 2))[:, None]
    light += rng.normal(0.0, NOISE, light.shape)
    codes = 2**BITS - 1
    coded = np.rint(np.clip(light, 0.0, 1.0) * codes) / codes
    return coded.astype(np.float32), normals.T[:, None]
