"""A prepared scene becomes a picture."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from impasto import _core
from impasto._internal.calls import ProgressCallback, reporting, thread_count
from impasto._internal.waiting import wait_for
from impasto.errors import GpuUnavailableError, ImpastoWarning
from impasto.gpu import adapters, lit_by_card
from impasto.image import (
    Image,
    Shown,
    columns_to_display,
    exposure_of_maximum,
    tone_curve,
)
from impasto.lighting import Prepared
from impasto.scene import Scene

Fidelity = Literal["photographs", "model"]
Backend = Literal["cpu", "gpu", "auto"]


def picture(
    prepared: Prepared,
    plan: _core.Plan,
    scene: Scene,
    extra: NDArray[np.float32] | None,
    *,
    again: Callable[[], NDArray[np.float32]] | None = None,
    backend: Backend = "cpu",
    threads: int | None = None,
    progress: bool | ProgressCallback = False,
) -> Image:
    """A prepared scene as planned.

    ``extra`` is light ``(band, y, x)`` besides the model's. With ``again``, which returns the XYZ
    of the same picture, display codes are made without planes of light where that is possible.
    """
    arguments, exposure = prepared.arguments, prepared.exposure
    workers = thread_count(threads)
    by_cpu = backend == "cpu"
    if again and by_cpu and extra is None and not prepared.from_picture and not plan.projected:
        size = prepared.surface.normal.shape[1:]
        codes, coverage = np.empty((*size, 3), np.uint8), np.empty(size, np.float32)
        with reporting(progress, "rendering") as callback:
            below, above = _core.paint(
                prepared.surface,
                prepared.relief,
                arguments,
                plan,
                columns_to_display(scene.display, exposure),
                tone_curve(scene.display),
                codes,
                coverage,
                workers,
                callback,
            )
        shown = Shown(codes, below, above)
        return Image(coverage, exposure, scene.display, again, shown, threads)
    with reporting(progress, "rendering") as callback:
        xyz, coverage = _light(prepared, plan, backend, workers, callback)
    if extra is not None:
        # Colours without spectra have one matrix for all lights.
        xyz += wait_for(_xyz_of, arguments.diffuse[0], extra)
    if prepared.from_picture:
        exposure = exposure_of_maximum(xyz, coverage)
        to_display = exposure * scene.display.linear_from_xyz
        light = np.linalg.solve(to_display, np.asarray(scene.background)).astype(np.float32)
        xyz += light[:, None, None] * (1.0 - coverage)
    return Image(coverage, exposure, scene.display, xyz, threads=threads)


def _light(
    prepared: Prepared,
    plan: _core.Plan,
    backend: Backend,
    workers: int,
    callback: ProgressCallback | None,
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Light and coverage, by a graphics card if that is wanted and possible, else by the CPU."""
    surface, relief, arguments = prepared.surface, prepared.relief, prepared.arguments
    real = any(adapter.kind != "cpu" for adapter in adapters()) if backend == "auto" else False
    if backend == "gpu" or real:
        adapter = "auto" if real else "any"
        try:
            return lit_by_card(surface, relief, arguments, plan, workers, callback, adapter)
        except GpuUnavailableError as error:
            warnings.warn(f"{error}; the CPU makes the picture", ImpastoWarning, stacklevel=4)
    return _core.render(surface, relief, arguments, plan, workers, callback)


def _xyz_of(matrix: NDArray[Any], extra: NDArray[np.float32]) -> NDArray[np.float32]:
    """Light of bands in XYZ; the background stays as it is."""
    return np.tensordot(matrix.T.astype(np.float32), np.nan_to_num(extra, nan=0.0), axes=1)
