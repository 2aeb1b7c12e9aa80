"""Our own fits, as settings call them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

import impasto
from impasto.effort import PRESETS, Effort, EffortLike
from impasto.fit.lobes import LobeSbrdf, fit_lobes
from impasto.fit.normals import Method, Normals
from impasto.fit.reflectance import Estimator, Reflectance
from impasto.rig import Rig
from impasto.stack import Stack
from impasto.training import Training, general_training
from study.held_out_error import Fitted
from study.pigments import GRID, NOISE, PigmentPhotograph


def sbrdf(stack: Stack, threads: int | None, **options: Any) -> Fitted:
    """A fit by :func:`impasto.fit_sbrdf` with these options; one lobe unless they say otherwise."""
    if "model" not in options:
        options = {"pooling": "painting"} | options
    fitted: Fitted = impasto.fit_sbrdf(stack, threads=threads, **options)
    return fitted


def always(
    stack: Stack,
    threads: int | None,
    *,
    lobes: int,
    effort: Effort = PRESETS["standard"],
    typical: bool = True,
    bounded: bool = True,
) -> LobeSbrdf:
    """A fixed number of lobes per pixel, without selection by BIC."""
    stereo = impasto.fit_normals(stack, threads=threads)
    return fit_lobes(
        stack,
        stereo,
        lobes=lobes,
        ambient=True,
        index=1.45,
        effort=effort,
        threads=threads,
        progress=False,
        typical=typical,
        sparing=False,
        bounded=bounded,
    )


def search(stack: Stack, threads: int | None, *, effort: Effort) -> LobeSbrdf:
    """One lobe of any width per pixel by a search alone, without the painting's typical lobe."""
    return always(stack, threads, lobes=1, effort=effort, typical=False, bounded=False)


@dataclass(frozen=True, eq=False)
class DiffuseSurface:
    """A surface without gloss, from photometric stereo alone."""

    normals: Normals

    @property
    def normal(self) -> NDArray[np.float32]:
        """``(3, y, x)``."""
        return self.normals.normal

    @property
    def status(self) -> NDArray[np.uint8]:
        """``(y, x)``."""
        return self.normals.status

    def predict(self, lights: Rig) -> NDArray[np.float32]:
        """``(obs, band, y, x)``."""
        return impasto.Surface(self.normals.normal, self.normals.albedo).predict(lights)


def lambert(
    stack: Stack, threads: int | None, *, method: Method, effort: EffortLike = "standard"
) -> Fitted:
    """Photometric stereo alone."""
    return DiffuseSurface(impasto.fit_normals(stack, method=method, effort=effort, threads=threads))


def reflectance(
    photograph: PigmentPhotograph,
    threads: int | None,
    *,
    estimator: Estimator,
    training: Training | None = None,
) -> Reflectance:
    """Spectra of photographed pigments, on the grid that they are compared on.

    The default training spectra contain centres of these pigments: without ``training`` the
    estimators learn from those that contain none.
    """
    return impasto.fit_reflectance(
        None,
        photograph.responses,
        photograph.camera,
        estimator=estimator,
        training=general_training() if training is None else training,
        noise=NOISE,
        wavelengths=GRID,
        integration="sum",
        threads=threads,
    )
