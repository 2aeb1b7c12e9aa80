"""The three fits as stages of a command."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from impasto.cli.console import Stages
from impasto.status import Status

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from impasto.bands import Camera
    from impasto.fit.reflectance import Reflectance
    from impasto.stack import Stack
    from impasto.systems import System
    from impasto.training import Training


def measured(
    stages: Stages,
    system: System,
    stack: Stack,
    camera: Camera | None,
    threads: int | None,
    gloss: dict[str, Any] | None = None,
    training: Training | None = None,
) -> tuple[Any, Reflectance | None]:
    """Normals, gloss and, if the camera is known, spectra.

    ``gloss`` holds arguments of :func:`impasto.fit_sbrdf` that replace those of the system;
    ``training`` replaces its training spectra.
    """
    import impasto
    from impasto.fit.reflectance import matching_camera
    from impasto.overview import gloss_words

    if camera is not None:
        matching_camera(camera, stack.bands)
    stack = system.prepared(stack)
    with stages.stage("normals") as stage:
        normals = system.fit_normals(stack, threads=threads, progress=stage.advance)
        stage.note = f"{system.method}; {_share_estimated(normals.status)} of the pixels"
    with stages.stage("gloss") as stage:
        sbrdf: Any
        if gloss:
            sbrdf = impasto.fit_sbrdf(
                stack,
                **gloss,
                normals=normals,
                effort=system.effort,
                threads=threads,
                progress=stage.advance,
            )
        else:
            sbrdf = system.fit_sbrdf(stack, normals, threads=threads, progress=stage.advance)
        stage.note = gloss_words(sbrdf).removeprefix("gloss: ")
    if camera is None:
        return sbrdf, None
    with stages.stage("reflectance") as stage:
        reflectance = system.fit_reflectance(
            stack, sbrdf, camera, training=training, threads=threads, progress=stage.advance
        )
        learnt = reflectance.info["training_count"]
        stage.note = (
            f"{system.estimator} from {learnt} spectra, {len(reflectance.basis)} basis spectra"
        )
    return sbrdf, reflectance


def _share_estimated(status: NDArray[np.uint8]) -> str:
    """``99.8 %`` of the pixels inside the mask."""
    inside = status != Status.MASKED
    share = float((status[inside] < Status.DARK).mean()) if inside.any() else 0.0
    return "100 %" if np.isclose(share, 1.0, rtol=0, atol=5e-5) else f"{100 * share:.2f} %"
