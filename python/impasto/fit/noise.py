"""How noisy the diffuse responses are: the scatter of the photographs around them."""

from __future__ import annotations

from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from impasto.lights import PointLight
from impasto.stack import Stack

SAMPLE = 4096
"""Pixels that are looked at, spread evenly over the picture."""

LIT = 0.2
"""Cosine of incidence below which samples are left out: shadows and interreflections dominate."""


@runtime_checkable
class _Lobes(Protocol):
    """An Sbrdf whose pixels have lobes of their own."""

    @property
    def diffuse(self) -> NDArray[np.float32]: ...

    @property
    def lobes(self) -> NDArray[np.uint8]: ...

    @property
    def residual(self) -> NDArray[np.float32]: ...


def noise_of_diffuse(stack: Stack, source: Any, diffuse: NDArray[np.float32]) -> float | None:
    """Standard deviation of a diffuse response, relative to white, or None if unknown.

    Residuals of the photographs against ``(n . l) rho`` over light directions give the noise of a
    sample: by their median, which neither highlights nor shadows move. A broad gloss, as of
    gilding, moves it nevertheless: where every pixel has lobes of its own, the residuals of that
    fit count if they are smaller. The noise of the response
    fitted to m samples is smaller by ``sqrt(n^T (L^T L)^-1 n)``, the standard error along the
    normal of the least-squares solution of eq. 2 (RGB-camera paper).

    Parameters
    ----------
    stack
        Photographs under distant lights.
    source
        What holds the ``normal (3, y, x)`` (a ``Normals`` or an ``Sbrdf``).
    diffuse
        ``(band, y, x)``.
    """
    normal = getattr(source, "normal", getattr(getattr(source, "normals", None), "normal", None))
    lights = stack.rig.lights
    if normal is None or len(lights) < 4 or any(isinstance(light, PointLight) for light in lights):
        return None
    usable = np.isfinite(normal).all(axis=0) & np.isfinite(diffuse).all(axis=0)
    rows, columns = np.nonzero(usable)
    if rows.size == 0:
        return None
    picked = np.linspace(0, rows.size - 1, min(SAMPLE, rows.size)).astype(np.intp)
    rows, columns = rows[picked], columns[picked]
    directions = np.array([light.direction for light in lights], dtype=np.float64)
    normals = np.asarray(normal, dtype=np.float64)[:, rows, columns]
    rho = diffuse[:, rows, columns].astype(np.float64)
    cosine = directions @ normals
    gain = stack.scale[:, None] / stack.rig.intensities[:, None, None]
    stored = stack.samples[:, :, rows, columns].astype(np.float64)
    value = (stored - stack.black[:, None]) * gain
    valid = np.isfinite(value) & (cosine > LIT)[:, None]
    if stack.saturation is not None:
        valid &= stored < stack.saturation[:, None]
    residual = np.abs(value - cosine[:, None] * rho)[valid]
    if residual.size < 16:
        return None
    # 1.4826 makes the median of a Gaussian's absolute values its standard deviation; three
    # unknowns per pixel were fitted to m samples.
    count = len(lights)
    sample = 1.4826 * float(np.median(residual)) * np.sqrt(count / (count - 3))
    if isinstance(source, _Lobes):
        sample = min(sample, _of_lobes(source, rows, columns, count))
    lit = (cosine > LIT).astype(np.float64)
    information = np.einsum("op,oi,oj->pij", lit, directions, directions)
    leverage = np.einsum("ip,pij,jp->p", normals, np.linalg.pinv(information), normals)
    return float(sample * np.sqrt(np.median(leverage)))


def _of_lobes(
    fitted: _Lobes, rows: NDArray[np.intp], columns: NDArray[np.intp], count: int
) -> float:
    """Noise of a sample from the residuals of lobes per pixel; infinite where they say nothing."""
    bands, lobes = len(fitted.diffuse), float(np.median(fitted.lobes[rows, columns]))
    # Of the normal two, of a lobe its shape; of the diffuse part, a lobe and ambient light a
    # strength per band.
    ambient = 0 if getattr(fitted, "ambient", None) is None else 1
    freedom = count * bands - (2 + lobes + bands * (1 + lobes + ambient))
    residual = fitted.residual[rows, columns]
    residual = residual[np.isfinite(residual)]
    if freedom <= 0 or residual.size < 16:
        return float("inf")
    return float(np.median(residual)) * float(np.sqrt(count * bands / freedom))
