"""A coat of varnish over a painting: absorption after Beer and Lambert, and a gloss of its own.

Light crosses the film on its way in and on its way out: the transmittance of a film of thickness d
for a light and an eye at the zenith angles t_l and t_v is

.. code-block:: text

    T(lambda) = exp(-a(lambda) d (1 / cos t'_l + 1 / cos t'_v)),    sin t' = sin t / n

with the refracted angles t' [@born1999principles]. The angles are those to the panel, not to each
pixel's normal: the film then is a factor on the spectra, part of the matrix from reflectance to
colour, and costs nothing per pixel.

What the interface below the film reflects with a neutral lobe is not absorbed: it keeps the colour
of the lamp. Light that goes to and fro within the film is left out.

The absorption of aged natural resins falls from violet to red, roughly exponentially.
``yellowness`` is the strength of such a curve, ``a = yellowness exp((450 - lambda) / 60)``: a model
with one parameter, not the measurement of a resin. ``absorption=`` takes measured curves.
"""

from __future__ import annotations

import math
import sys
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from impasto._internal.checks import MOST, number, numbers, positive, refractive_index, truth
from impasto.colour.wavelengths import checked_wavelengths
from impasto.errors import ArgumentError

AT_NM = 450.0
"""Where ``yellowness`` is the absorption."""
FALL_NM = 60.0
"""Over so many nm the absorption of yellowed resin falls to 1 / e."""
PHOTOGRAPHED = (0.5**0.5, 1.0)
"""Cosines to light and eye that stand for all photographs: lamps at 45 degrees, camera in front."""
GRAZING = 1e-12
"""Smallest squared cosine in the film: the way of grazing light at index 1 stays a number."""
NARROWEST, WIDEST = 5e-4, 1.25
"""Half-widths in radians that the lobe model tells apart (``GAMMA_MIN``, ``GAMMA_MAX`` of
``brdf/torrance_sparrow.rs``)."""
OPAQUE = 0.02
"""Below it a film hides what lies under it: dividing by it multiplies noise by 50."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Varnish:
    """A coat of varnish over the painting as it was fitted, for ``Scene(varnish=...)``.

    Needs spectra: ``reflectance=`` or ``camera=`` of :func:`impasto.render`.

    The coat reflects with a Torrance-Sparrow lobe of its own. The lobes of the painting then belong
    to the interface between paint and varnish, which reflects less: for paint of index 1.45 under
    varnish of 1.54 their gloss falls to 0.027 of what it was in air, the ratio of the Fresnel
    reflectances of both interfaces at normal incidence. Their beta is multiplied by 0.020, since
    their Fresnel factor becomes that of the varnish. The film absorbs light of coloured lobes, not
    that of neutral ones. What the lobes of a pixel reflect beyond an interface of index 1.7 comes
    from metal leaf and stays. On a surface of Lafortune lobes the coat's lobe is the
    Lafortune lobe of the same width and of the same strength in front, without Fresnel's rise.

    Parameters
    ----------
    thickness_um
        Thickness of the film in micrometres.
    index
        Index of refraction; about 1.54 for aged dammar and mastic, 1.48 for acrylic resins.
    yellowness
        Absorption at 450 nm in 1/mm (natural logarithm); 0: clear. It falls by 1/e per 60 nm. With
        50 micrometres 10 is a yellowed, 30 a brown varnish.
    absorption
        Instead of ``yellowness``: ``(wavelengths, values)`` in nm and 1/mm, interpolated linearly,
        its end values continued.
    gamma
        Half-width of the facets of its surface in radians, 5e-4 to 1.25.
    beta
        Strength of its lobe; default: ``ln 2 / (4 gamma^2)``, with which the lobe reflects as much
        as a smooth interface of this index does. 0: no gloss.
    removed
        The painting was photographed under this varnish, and is shown without it: spectra are
        divided by its transmittance for lamps at 45 degrees and a camera in front. The gloss
        stays as it was fitted.

    Raises
    ------
    ArgumentError
        Values out of range; a varnish to be removed that hides the painting at a wavelength.

    Examples
    --------
    >>> from impasto import Varnish
    >>> old = Varnish(thickness_um=50.0, yellowness=10.0)
    >>> old.transmittance([450.0, 550.0, 650.0]).round(2).tolist()
    [0.37, 0.83, 0.96]
    >>> old.clear().transmittance([450.0]).tolist()
    [1.0]
    """

    thickness_um: float = 50.0
    index: float = 1.54
    yellowness: float = 0.0
    absorption: tuple[ArrayLike, ArrayLike] | None = None
    gamma: float = 0.05
    beta: float | None = None
    removed: bool = False

    def __post_init__(self) -> None:
        set_ = object.__setattr__
        positive(self.thickness_um, "thickness_um", "a positive thickness in micrometres")
        set_(self, "index", refractive_index(self.index))
        _not_negative(self.yellowness, "yellowness", "1/mm from 0 on")
        positive(self.gamma, "gamma", "an angle in radians", NARROWEST, WIDEST)
        if self.beta is not None:
            _not_negative(self.beta, "beta", f"a strength from 0 to {MOST:g}, or None", MOST)
        set_(self, "removed", truth(self.removed, "removed"))
        if self.absorption is not None:
            set_(self, "absorption", _curve(self.absorption, self.yellowness))

    def clear(self) -> Varnish:
        """The same coat without its colour."""
        return replace(self, yellowness=0.0, absorption=None)

    def without(self) -> Varnish:
        """The same varnish removed, for a painting that was photographed under it."""
        return replace(self, removed=True)

    @property
    def strength(self) -> float:
        """Beta of the coat's lobe."""
        energy = math.log(2.0) / (4.0 * self.gamma**2)
        return energy if self.beta is None else float(self.beta)

    def coefficients(self, wavelengths: ArrayLike) -> NDArray[np.float64]:
        """Absorption ``(n,)`` in 1/mm, natural logarithm, at wavelengths in nm."""
        grid = checked_wavelengths(wavelengths)
        if self.absorption is not None:
            given, values = self.absorption
            found = np.interp(grid, np.asarray(given), np.asarray(values))
        else:
            found = self.yellowness * np.exp((AT_NM - grid) / FALL_NM)
        return np.asarray(found)

    def path(self, light: float = 1.0, view: float = 1.0) -> float:
        """Way through the film in thicknesses, for the cosines of the zenith angles outside."""
        return sum(
            1.0 / math.sqrt(max(GRAZING, 1.0 - (1.0 - cosine * cosine) / self.index**2))
            for cosine in (light, view)
        )

    def transmittance(
        self, wavelengths: ArrayLike, light: float = 1.0, view: float = 1.0
    ) -> NDArray[np.float64]:
        """``(n,)``: the share of light that crosses the film twice.

        Parameters
        ----------
        wavelengths
            ``(n,)`` nm.
        light, view
            Cosines of the zenith angles of light and eye, 0 to 1; default: both in front.

        Raises
        ------
        ArgumentError
            No wavelengths, or no such cosine.
        """
        for value, name in ((light, "light"), (view, "view")):
            expected = "the cosine of a zenith angle, 0 to 1"
            # Unit vectors of rounded numbers are longer than 1 by a few roundings.
            if not 0.0 <= number(value, name, expected) <= 1.0 + 1e-6:
                raise ArgumentError(f"{name}: expected {expected}, found {value!r}")
        millimetres = 1e-3 * self.thickness_um * self.path(light, view)
        return np.exp(-millimetres * self.coefficients(wavelengths))

    def factor(self, wavelengths: ArrayLike, light: float, view: float) -> NDArray[np.float64]:
        """``(n,)``: by what the scene multiplies spectra; the parameters of :meth:`transmittance`.

        Raises
        ------
        ArgumentError
            A varnish to be removed that hides the painting at a visible wavelength.
        """
        if not self.removed:
            return self.transmittance(wavelengths, light, view)
        crossed = self.transmittance(wavelengths, *PHOTOGRAPHED)
        grid = checked_wavelengths(wavelengths)
        hidden = (crossed < OPAQUE) & (grid >= 400.0) & (grid <= 700.0)
        if hidden.any():
            at = int(np.flatnonzero(hidden)[0])
            raise ArgumentError(
                f"varnish: it transmits {100 * crossed[at]:.2g} % at {grid[at]:g} nm, so the "
                "photographs do not show what lies under it; remove a thinner or paler varnish"
            )
        return 1.0 / np.maximum(crossed, OPAQUE)


def _curve(given: tuple[ArrayLike, ArrayLike], yellowness: float) -> tuple[ArrayLike, ArrayLike]:
    if yellowness != 0.0:
        raise ArgumentError("absorption: give it or yellowness, not both")
    if not isinstance(given, tuple) or len(given) != 2:
        raise ArgumentError("absorption: expected a pair (wavelengths, values per mm)")
    grid = checked_wavelengths(given[0], "absorption wavelengths")
    values = numbers(given[1], "absorption", "values in 1/mm from 0 on")
    if values.shape != grid.shape or not (np.isfinite(values) & (values >= 0.0)).all():
        raise ArgumentError(
            f"absorption: expected {grid.size} finite values from 0 on, in 1/mm, found {given[1]!r}"
        )
    return grid, values


def _not_negative(value: float, name: str, expected: str, most: float = sys.float_info.max) -> None:
    if not 0.0 <= number(value, name, expected) <= most:
        raise ArgumentError(f"{name}: expected {expected}, found {value!r}")
