"""Lafortune lobes of every pixel: the three passes of the third paper."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from impasto import _core
from impasto._internal.border import StackArguments
from impasto._internal.calls import ProgressCallback, reporting, thread_count
from impasto.effort import Effort
from impasto.fit.normals import Normals
from impasto.fit.result import PerPixelSbrdf, deviation, median, shared_fields
from impasto.fit.saved import over
from impasto.fit.start import StartArguments
from impasto.io.results import SavedMaps
from impasto.stack import Stack
from impasto.surface import Surface

VERDICTS = ("fitted", "one-view")

FRONTAL_FRESNEL = (0.45 / 2.45) ** 2
"""Fresnel reflectance of an interface of index 1.45 seen from the front, ((n - 1) / (n + 1))^2."""


@dataclass(frozen=True, eq=False, repr=False)
class LafortuneSbrdf(PerPixelSbrdf):
    """A painting whose pixels have Lafortune lobes of their own.

    Radiance ``irradiance (N.L) (diffuse + sum over lobes of specular d^exponent)`` with
    ``d = cxy (L.V - (N.L)(N.V)) + cz (N.L)(N.V)``, 0 where it is negative: Lafortune et al. 1997
    with ``Cx = Cy``, about the free normal of the third paper. Only the product
    ``specular * d**exponent`` is determined: a larger ``(cxy, cz)`` and a smaller ``specular`` give
    the same. As in McAllister et al. 2002, the strength is separated by ``cxy**2 + cz**2 = 2``, so
    that Phong's mirror lobe is (-1, 1) and ``specular`` its peak.

    :class:`Sbrdf` has the members of all results. ``normal`` was fitted together with the lobes, on
    the mean of the bands, starting from the direction of a cosine lobe. ``sigma`` is NaN where the
    normal is that of photometric stereo. Gross outliers are excluded, also from ``residual``. Where
    views differ, pixels are estimated even if their lights lie in a plane (``RANK_DEFICIENT`` in
    ``normals``).

    Attributes
    ----------
    specular
        ``(lobe, band, y, x)`` float32 strength of each lobe in each band, from 0 on; 0 where a
        pixel has fewer lobes.
    lobes
        ``(y, x)`` uint8: number of lobes that the photographs support. Under any light and view, a
        lobe reflects at most 64 times its largest value in the photographs of the pixel.
    cxy, cz, exponent
        ``(lobe, y, x)`` float32 shape of each lobe, the sharpest first; NaN where there is none.
    specular_sigma
        ``(lobe, y, x)`` float32 relative standard deviation of ``specular``, the mean of the bands.
        Like the next two, it takes the noise from the residuals of the pixel and includes the
        errors of all other parameters (normal, diffuse part, other lobes). It is NaN where there is
        no lobe, where there are as many samples as unknowns, and where the samples do not determine
        the parameter: one at its bound, or one that another can replace to 12 digits.
    direction_sigma
        ``(lobe, y, x)`` float32 standard deviation, radians, of the direction of ``(cxy, cz)``:
        under light at 45 degrees, ``specular`` is the largest reflection of the lobe into any view
        in the plane of incidence, and this is the error of that view. The deviation of ``cxy`` is
        this times ``cz``, that of ``cz`` this times ``cxy``. Also NaN where the direction is fixed
        (``"one-view"``).
    exponent_sigma
        ``(lobe, y, x)`` float32 standard deviation of log exponent.
    verdict
        ``"fitted"``; ``"one-view"``: all photographs have one view, which cannot distinguish a
        tilted normal from a tilted lobe. Normals are then those of photometric stereo, and lobes
        are Phong's (``cxy = -1``, ``cz = 1``).
    """

    SHAPE: ClassVar[tuple[str, ...]] = ("cxy", "cz", "exponent")

    cxy: NDArray[np.float32] = field(metadata=over("lobe", "y", "x"))
    cz: NDArray[np.float32] = field(metadata=over("lobe", "y", "x"))
    exponent: NDArray[np.float32] = field(metadata=over("lobe", "y", "x"))
    specular_sigma: NDArray[np.float32] = field(metadata=over("lobe", "y", "x"))
    direction_sigma: NDArray[np.float32] = field(metadata=over("lobe", "y", "x", unit="rad"))
    exponent_sigma: NDArray[np.float32] = field(metadata=over("lobe", "y", "x"))
    verdict: str = field(metadata=over(dtype=np.str_))

    def surface(self) -> Surface:
        """The painting with the lobes of every pixel, for rendering."""
        return Surface.lafortune(
            self.normal,
            self.diffuse,
            self.specular,
            self.cxy,
            self.cz,
            self.exponent,
            **self._place(),
        )

    @property
    def width(self) -> NDArray[np.float32]:
        """``(lobe, y, x)`` radians: half the angle at which a Phong lobe has halved.

        The highlight moves by twice the tilt of a facet, so this is comparable with the ``gamma``
        of Torrance-Sparrow lobes. NaN where there is no lobe.
        """
        return np.asarray(0.5 * np.arccos(0.5 ** (1.0 / self.exponent)), dtype=np.float32)

    def _beta(self, strength: NDArray[np.float32]) -> NDArray[np.float32]:
        """The beta whose frontal highlight is as bright as a Phong lobe of this strength.

        At index 1.45, as a Torrance-Sparrow fit has by default.
        """
        return strength / np.float32(FRONTAL_FRESNEL)

    def lobe_words(self, lobe: int, y: int, x: int) -> str:
        """The sharpness of a pixel's lobe in a legend."""
        exponent, sigma = (float(m[lobe, y, x]) for m in (self.exponent, self.exponent_sigma))
        return f"n = {exponent:.3g}" + deviation(sigma)

    def report(self) -> dict[str, Any]:
        """Plain numbers of the gloss for a report file."""
        medians = {
            "exponent_median": self.exponent,
            "exponent_sigma_median": self.exponent_sigma,
            "specular_sigma_median": self.specular_sigma,
            "direction_sigma_degrees_median": np.degrees(self.direction_sigma),
        }
        numbers = {name: [median(plane) for plane in map_] for name, map_ in medians.items()}
        return {**super().report(), **numbers, "verdict": self.verdict}

    def _demand(self, maps: SavedMaps, prefix: str = "") -> None:
        known = ", ".join(VERDICTS)
        maps.demand(
            f"{prefix}verdict", self.verdict in VERDICTS, f"is {self.verdict!r}, none of {known}"
        )

    def _gloss(self) -> str:
        words = super()._gloss()
        return words if self.verdict == "fitted" else f"{words} ({self.verdict})"


def fit_lafortune(
    stack: Stack,
    stereo: Normals,
    *,
    lobes: int,
    effort: Effort,
    threads: int | None,
    progress: bool | ProgressCallback,
) -> LafortuneSbrdf:
    """Lobes of every pixel, from the maps of photometric stereo; see :func:`impasto.fit_sbrdf`."""
    arguments = StackArguments.of(stack)
    maps = _empty(stack, lobes)
    with reporting(progress, "lobes") as callback:
        _core.fit_lafortune(
            arguments,
            StartArguments.of(stereo),
            maps,
            lobes,
            effort.rounds,
            thread_count(threads),
            callback,
        )
    return LafortuneSbrdf(
        **shared_fields(maps, stack, stereo),
        specular=maps["specular"],
        cxy=maps["cxy"],
        cz=maps["cz"],
        exponent=maps["exponent"],
        specular_sigma=maps["specular_sigma"],
        direction_sigma=maps["direction_sigma"],
        exponent_sigma=maps["exponent_sigma"],
        lobes=maps["lobes"],
        verdict="fitted" if _core.views_differ(arguments.rig) else "one-view",
    )


def _empty(stack: Stack, lobes: int) -> _core.LafortuneMaps:
    """Maps whose every value the numerics write."""
    _, bands, height, width = stack.shape

    def plane(*planes: int) -> NDArray[np.float32]:
        return np.empty((*planes, height, width), dtype=np.float32)

    return {
        "normal": plane(3),
        "diffuse": plane(bands),
        "specular": plane(lobes, bands),
        "cxy": plane(lobes),
        "cz": plane(lobes),
        "exponent": plane(lobes),
        "specular_sigma": plane(lobes),
        "direction_sigma": plane(lobes),
        "exponent_sigma": plane(lobes),
        "lobes": np.empty((height, width), dtype=np.uint8),
        "residual": plane(),
        "sigma": plane(),
        "status": np.empty((height, width), dtype=np.uint8),
    }
