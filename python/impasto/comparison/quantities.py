"""What is compared of a painting, with predicted errors, over a window of its own pixels."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impasto.comparison.bounds import bounds_of
from impasto.comparison.registration import Alignment
from impasto.fit.lafortune import LafortuneSbrdf
from impasto.fit.lobes import LobeSbrdf
from impasto.fit.pooled import PooledSbrdf
from impasto.fit.result import PerPixelSbrdf, Sbrdf
from impasto.fit.segments import Segment, SegmentSbrdf
from impasto.merge.resampling import Samples
from impasto.status import Status

Planes = NDArray[np.float64]

EXCESS = 1.2
"""The Cramer-Rao bound is a lower one: with lobes of its own for every pixel, from a dozen or two
photographs, errors are so many times larger, measured on simulated paintings."""
BETWEEN = 0.5
"""Of the difference between cubic and linear interpolation, what counts as its error. With it a
painting that was photographed again, shifted by parts of a pixel, has about as few marked pixels
of its normals as one that was not shifted, and still detects changes of a degree."""
NO_HIGHLIGHT = "no-highlight"
"""The verdict of a segment whose photographs show none."""


@dataclass(frozen=True, eq=False)
class Quantities:
    """Planes ``(..., n)`` or ``(..., y, x)``.

    Attributes
    ----------
    lobes
        How many lobes the photographs of a pixel support.
    normal, diffuse
        ``(3, ...)`` and ``(band, ...)``.
    sigma
        Standard deviation of the normal, radians.
    noise
        Standard deviation of a diffuse colour in one band.
    freedom
        Degrees of freedom of the residuals behind these.
    beta, beta_sigma
        Sum of the lobes' strengths, mean over the bands; 0: no lobe.
    gamma, gamma_sigma
        Width of the strongest lobe, radians, and the standard deviation of its logarithm.
    known
        Whether there is an estimate.
    """

    lobes: Planes
    normal: Planes
    diffuse: Planes
    sigma: Planes
    noise: Planes
    freedom: Planes
    beta: Planes
    beta_sigma: Planes
    gamma: Planes
    gamma_sigma: Planes
    known: NDArray[np.bool_]


def quantities_of(part: Sbrdf) -> Quantities:
    """Those of a part of a result.

    Errors of colours and strengths are those of :mod:`~impasto.comparison.bounds`, from the
    standard deviation of the residuals, corrected for the unknowns that they were fitted with, and
    for photographs that a pixel did not use.
    """
    bands = len(part.bands)
    used = part.normals.used.astype(np.float64)
    samples = np.maximum(used, 1.0) * bands
    freedom = np.maximum(samples - bands - 2.0 - _unknowns_of_lobes(part), 1.0)
    deviation = part.residual.astype(np.float64) * np.sqrt(samples / freedom)
    normal = part.normal.astype(np.float64)
    own = deviation * np.sqrt(len(part.rig) / np.maximum(used, 1.0))
    sigma = part.sigma.astype(np.float64)
    given = None
    if isinstance(part, LafortuneSbrdf) and part.verdict == "one-view":
        # Its normals are those of photometric stereo, and so are their errors, but for residuals
        # that the lobes explain: these are in both paintings.
        stereo = np.maximum(part.normals.residual.astype(np.float64), 1e-12)
        explained = np.minimum(part.residual.astype(np.float64) / stereo, 1.0)
        sigma = given = part.normals.sigma.astype(np.float64) * explained
    bounds = bounds_of(part, own, _width_errors(part), given)
    excess = EXCESS if isinstance(part, PerPixelSbrdf) else 1.0
    beta, gamma, gamma_sigma = _gloss(part, bounds.shape)
    beta_sigma = bounds.beta * _beta_unit(part)
    if isinstance(part, SegmentSbrdf):
        beta, gamma, beta_sigma, gamma_sigma = _of_segments(part)
    return Quantities(
        lobes=_lobes(part),
        normal=normal,
        diffuse=part.diffuse.astype(np.float64),
        sigma=sigma,
        noise=bounds.diffuse * excess,
        freedom=freedom,
        beta=beta,
        beta_sigma=beta_sigma * excess,
        gamma=gamma,
        gamma_sigma=gamma_sigma * excess,
        known=part.status < Status.DARK,
    )


def words_of(kind: type[Sbrdf]) -> str:
    """What gloss a kind of fit has, for a table."""
    if issubclass(kind, LafortuneSbrdf):
        return "Lafortune lobes per pixel"
    if issubclass(kind, PerPixelSbrdf):
        return "lobes per pixel"
    return "a lobe per segment" if issubclass(kind, SegmentSbrdf) else "one lobe for the painting"


def has_places(kind: type[Sbrdf]) -> bool:
    """Whether pixels or segments have a gloss of their own; else it differs all over or not."""
    return issubclass(kind, PerPixelSbrdf | SegmentSbrdf)


def resampled(own: Quantities, samples: Samples, alignment: Alignment) -> Quantities:
    """Quantities ``(..., n)`` at places between pixels, with the rotation and gain of an alignment.

    Normals and colours are interpolated by cubic convolution; errors and widths, which are no
    surfaces, bilinearly among known pixels. A place is known where its nearest pixel is. By how
    much straight lines between pixels give other normals and colours says how much lies between
    pixels that no interpolation knows: :data:`BETWEEN` of it is added to the errors.
    """
    there = own.known
    found: dict[str, Any] = {"known": np.asarray(samples.picked(there))}
    nothing = np.zeros(there.shape, np.uint8)
    between: dict[str, Planes] = {}
    for one in fields(Quantities):
        plane = getattr(own, one.name)
        if one.name in {"normal", "diffuse"}:
            single = plane.astype(np.float32)
            found[one.name] = samples.interpolated(single, there)
            straight = samples.alike(nothing, np.where(there, single, np.float32(np.nan)))
            between[one.name] = (found[one.name] - straight) ** 2
        elif one.name != "known":
            masked = np.where(there, plane, np.nan).astype(np.float32)[None]
            found[one.name] = samples.alike(nothing, masked)[0]
    tilts, tints = between["normal"].sum(axis=0), between["diffuse"].mean(axis=0)
    found["sigma"] = np.hypot(found["sigma"], BETWEEN * np.sqrt(tilts))
    found["noise"] = np.hypot(found["noise"], BETWEEN * np.sqrt(tints))
    rotated = alignment.turn @ found["normal"]
    found["normal"] = rotated / np.linalg.norm(rotated, axis=0)
    found["diffuse"] = found["diffuse"] * alignment.gain[:, None]
    return Quantities(**found)


def _unknowns_of_lobes(part: Sbrdf) -> Planes:
    """Those that a pixel has for its own lobes: widths, strengths, and light of no direction."""
    none = np.zeros(part.shape)
    if isinstance(part, LobeSbrdf):
        ambient = float(np.nanmax(part.ambient, initial=0.0)) > 0.0
        strengths = np.where(part.tinted, len(part.bands), 1)
        within = np.arange(len(part.tinted))[:, None, None] < part.lobes
        own = np.sum((1 + strengths) * within, axis=0) + len(part.bands) * ambient
        return np.asarray(none + own)
    if isinstance(part, LafortuneSbrdf):
        return none + part.lobes * (2.0 + len(part.bands))
    return none


def _lobes(part: Sbrdf) -> Planes:
    if isinstance(part, PerPixelSbrdf):
        return part.lobes.astype(np.float64)
    return np.ones(part.shape)


def _width_errors(part: Sbrdf) -> NDArray[np.float32] | None:
    """Errors of the logarithm of each lobe's last shape number; None: one lobe for many pixels."""
    if isinstance(part, LobeSbrdf):
        return part.gamma_sigma
    return part.exponent_sigma if isinstance(part, LafortuneSbrdf) else None


def _of_segments(part: SegmentSbrdf) -> tuple[Planes, Planes, Planes, Planes]:
    """Strength and width of each segment's lobe, and their errors, as in :class:`Quantities`.

    A segment without a highlight has strength 0, with no error of its own: what the other painting
    has there is held against its own error. Errors are NaN where a segment has the painting's lobe,
    and at its border: between pixels of two segments there is no gloss to be interpolated.
    """
    import cv2

    def entry(one: Segment) -> tuple[float, float, float, float]:
        if one.verdict == NO_HIGHLIGHT:
            return 0.0, np.nan, 0.0, np.nan
        strength, width = np.sqrt(np.diag(one.covariance)) if one.own else (np.nan, np.nan)
        return one.beta, one.gamma, one.beta * strength, width

    whole = part.painting.beta, part.painting.gamma, np.nan, np.nan
    table = {one.label: entry(one) for one in part.segments}
    labels, place = np.unique(part.labels, return_inverse=True)
    entries = np.array([table.get(int(label), whole) for label in labels], np.float64)
    codes = place.reshape(part.shape).astype(np.float32)
    around = np.ones((3, 3), np.uint8)
    border = cv2.dilate(codes, around) != cv2.erode(codes, around)
    planes = np.moveaxis(entries[place.reshape(part.shape)], -1, 0)
    known = part.status < Status.DARK
    planes[:, ~known] = np.nan
    planes[2:, border] = np.nan
    beta, gamma, beta_sigma, gamma_sigma = planes
    return beta, np.where(beta > 0.0, gamma, np.nan), beta_sigma, gamma_sigma


def _beta_unit(part: Sbrdf) -> float:
    """The beta of a lobe of strength 1."""
    one = np.ones(1, np.float32)
    return float(part._beta(one)[0]) if isinstance(part, PerPixelSbrdf) else 1.0


def _gloss(part: Sbrdf, shape_errors: Planes) -> tuple[Planes, Planes, Planes]:
    """Strength and width of the gloss, and the error of the width from those of the shapes."""
    if isinstance(part, PooledSbrdf | SegmentSbrdf):
        known = part.status < Status.DARK
        beta = np.where(known, part.beta, np.nan).astype(np.float64)
        gamma = np.where(beta > 0.0, part.gamma, np.nan)
        return beta, gamma, np.full(part.shape, np.nan)
    assert isinstance(part, PerPixelSbrdf)
    strengths = part._beta(part.specular.mean(axis=1)).astype(np.float64)
    beta = strengths.sum(axis=0)
    strongest = np.nan_to_num(strengths, nan=-1.0).argmax(axis=0)[None]

    def of_strongest(planes: NDArray[Any]) -> Planes:
        found = np.take_along_axis(planes, strongest, axis=0)[0].astype(np.float64)
        return np.where(beta > 0.0, found, np.nan)

    gamma = of_strongest(part.width)
    error = of_strongest(shape_errors)
    if isinstance(part, LafortuneSbrdf):
        # The width goes with the square root of the exponent.
        error = 0.5 * error
    return beta, gamma, error
