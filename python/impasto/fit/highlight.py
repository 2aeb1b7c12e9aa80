"""One Torrance-Sparrow lobe per pixel where the angles are known: the engine by itself."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from impasto import _core
from impasto._internal.calls import ProgressCallback, reporting, thread_count
from impasto._internal.checks import unmasked
from impasto._internal.waiting import floats
from impasto.errors import ArgumentError


@dataclass(frozen=True, eq=False)
class HighlightFit:
    """Strength and width of every pixel's lobe; NaN where ``status`` says they are not known.

    Parameters
    ----------
    beta
        ``(...)`` float32, strength; 0 where the status is ``DARK``.
    gamma
        ``(...)`` float32, half-width at half maximum of the facets' tilt, rad.
    covariance
        ``(3, ...)`` float32: variance of beta, covariance, variance of gamma, for residuals as
        large as those found. NaN where the status is ``EXACT``, too. A variance of beta below
        1.2e-38, the smallest normal number, is given as that number: an upper limit.
    residual
        ``(...)`` float32, root mean square of the residuals; NaN where the status is ``EXACT``.
    status
        ``(...)`` uint8, see :class:`~impasto.Status`: ``FITTED``; ``EXACT`` (two samples);
        ``ILL_CONDITIONED`` (gamma at its bound of 5e-4 or 1.25 rad, its standard deviation
        larger than itself, or a search that has not converged); ``DARK`` (no sample is
        positive, or no lobe helps to explain them);
        ``RANK_DEFICIENT`` (no sample tells the width, or all lie so far from the mirror's angle
        that no number holds the strength or its variance); ``TOO_FEW_SAMPLES``;
        ``INVALID_INPUT`` (no finite sample, or samples so large, from some 1e19 on, that single
        precision does not hold the variance of their strength).
    """

    beta: NDArray[np.float32]
    gamma: NDArray[np.float32]
    covariance: NDArray[np.float32]
    residual: NDArray[np.float32]
    status: NDArray[np.uint8]


def fit_highlight(
    phi: ArrayLike,
    samples: ArrayLike,
    *,
    threads: int | None = None,
    progress: bool | ProgressCallback = False,
) -> HighlightFit:
    """Fit ``samples = beta exp(-ln 2 phi^2 / gamma^2)`` to every pixel by least squares.

    The specular term of the RGB-camera paper's eq. 9 where ``F G / (N . V)`` is one, or has been
    divided out: the smallest call into the fitting engine, and the one to time it by.
    :func:`fit_sbrdf` is the call that measures a painting.

    Parameters
    ----------
    phi
        ``(obs, ...)`` angles between normal and half vector, rad; NaN leaves a sample out.
    samples
        ``(obs, ...)`` specular light; NaN leaves a sample out, and so does numpy's mask of either
        array. C-contiguous float32 arrays are
        borrowed, others converted.
    threads, progress
        As everywhere: None means every allowed core; a bool or a callable ``(done, total)``.

    Returns
    -------
    HighlightFit
        Maps of the samples' shape without its first axis.

    Raises
    ------
    ArgumentError
        If the shapes differ or there is nothing to fit.

    Examples
    --------
    >>> import numpy as np
    >>> phi = np.linspace(0.0, 0.5, 16)[:, None] * np.ones(1000)
    >>> found = impasto.fit_highlight(phi, 100.0 * np.exp(-np.log(2) * phi**2 / 0.2**2))
    >>> bool(np.allclose(found.gamma, 0.2, rtol=1e-5))
    True
    """
    angles, values = _floats(phi, "phi"), _floats(samples, "samples")
    if angles.shape != values.shape:
        raise ArgumentError(
            f"phi: expected the shape of samples, {values.shape}, found {angles.shape}"
        )
    if values.size == 0:
        raise ArgumentError(f"samples: expected (obs, ...) numbers, found shape {values.shape}")
    shape = values.shape[1:]
    pixels = values.size // len(values)
    flat = HighlightFit(
        beta=np.empty(pixels, dtype=np.float32),
        gamma=np.empty(pixels, dtype=np.float32),
        covariance=np.empty((3, pixels), dtype=np.float32),
        residual=np.empty(pixels, dtype=np.float32),
        status=np.empty(pixels, dtype=np.uint8),
    )
    rows = (len(values), pixels)
    with reporting(progress, "lobes") as callback:
        _core.fit_highlight(
            values.reshape(rows), angles.reshape(rows), flat, thread_count(threads), callback
        )
    return HighlightFit(
        beta=flat.beta.reshape(shape),
        gamma=flat.gamma.reshape(shape),
        covariance=flat.covariance.reshape(3, *shape),
        residual=flat.residual.reshape(shape),
        status=flat.status.reshape(shape),
    )


def _floats(values: ArrayLike, name: str) -> NDArray[np.float32]:
    """An array of real numbers in single precision; what is beyond its range does not count."""
    found, masked = unmasked(values)
    if found.dtype.kind not in "fiu":
        raise ArgumentError(f"{name}: expected an array of real numbers, found {found.dtype}")
    with np.errstate(over="ignore"):
        single = floats(found)
    return single if masked is None else np.where(masked, np.float32(np.nan), single)
