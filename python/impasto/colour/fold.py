"""The colour of a scene as one matrix: coefficients, XYZ, adaptation, display.

Reflected light is diffuse(lambda) E + specular E, and every step from there to linear display light
is linear. With reflectance as k coefficients on a basis, the whole chain is a 3 x k matrix for the
diffuse part and a 3-vector for the interface part (which has the colour of the light), followed by
the display's tone curves.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from impasto.colour.adaptation import Adaptation, Mode, adaptation
from impasto.colour.display import CHANNELS, Display
from impasto.colour.illuminants import Illuminant
from impasto.colour.observers import STANDARD_OBSERVER, White, checked_white, xyz_from_spectrum
from impasto.colour.session import as_display
from impasto.colour.wavelengths import Floats, checked_spectra, checked_wavelengths
from impasto.errors import ArgumentError


@dataclass(frozen=True)
class WhiteScale:
    """The brightness of white on a display.

    Attributes
    ----------
    scale
        Factor on all light before the display; white at Y = 1 is shown at Y = ``scale``.
    channel
        The channel that reaches its maximum first: it limits the scale.
    linear
        ``(3,)`` linear display light of the scaled white.
    clipped
        Channels in which the scaled white exceeds full drive: only with an explicit scale.
    unreachable
        Channels in which white lies below the display's black: the white is outside the display's
        colours, and no scale helps.
    """

    scale: float
    channel: str
    linear: Floats
    clipped: tuple[str, ...]
    unreachable: tuple[str, ...]


@dataclass(frozen=True)
class XyzFold:
    """Coefficients to XYZ as seen.

    Attributes
    ----------
    diffuse
        ``(3, k)``: XYZ of the diffuse part is ``diffuse @ coefficients``.
    interface
        ``(3,)``: XYZ per unit of interface reflection, the colour of the light.
    adaptation
        None: the eye sees the light as it is.
    """

    diffuse: Floats
    interface: Floats
    adaptation: Adaptation | None


@dataclass(frozen=True)
class Fold:
    """Coefficients to linear display light, and the curves from there to codes.

    Attributes
    ----------
    diffuse
        ``(3, k)``: linear light of the diffuse part is ``diffuse @ coefficients``.
    interface
        ``(3,)``: linear light per unit of interface reflection; the white of the scene.
    display
        Its curve turns linear light into codes.
    white
        The scale that is in ``diffuse`` and ``interface``.
    adaptation
        None: the eye sees the light as it is.
    """

    diffuse: Floats
    interface: Floats
    display: Display
    white: WhiteScale
    adaptation: Adaptation | None

    def table(self, n: int = 65536) -> NDArray[np.float32]:
        """``(3, n)`` codes at ``n`` evenly spaced linear values from 0 to 1."""
        return self.display.table(n)

    def report(self) -> dict[str, Any]:
        """Numbers and names for a report file."""
        seen = self.adaptation
        return {
            "display": self.display.name,
            "white_scale": self.white.scale,
            "white_limited_by": self.white.channel,
            "white_linear": self.white.linear.tolist(),
            "white_clipped": list(self.white.clipped),
            "white_unreachable": list(self.white.unreachable),
            "adaptation": None
            if seen is None
            else {
                "d": seen.d,
                "mode": seen.mode,
                "test_kelvin": seen.test_temperature,
                "adapted_kelvin": seen.adapted_temperature,
                "reference_kelvin": seen.reference_temperature,
            },
        }


def white_scale(
    white: ArrayLike,
    display: Display | str | Path,
    rule: Literal["fit", "luminance"] | float = "fit",
) -> WhiteScale:
    """The largest brightness of white without clipping.

    Parameters
    ----------
    white
        XYZ ``(3,)`` of the white to show, Y = 1 meaning the display's peak luminance.
    display
        A display, the name of a standard one, or its file (:func:`read_display`).
    rule
        ``"fit"``: the largest scale that clips no channel (1 / max RGB). Under D65 the paper's
        white at d = 0.56 has red at 1.37, so Y may be 0.73 of the peak.
        ``"luminance"``: white has the display's peak luminance, as the paper writes it; channels
        that clip are named in the result.
        A number: this scale, with the same report.

    Raises
    ------
    ArgumentError
        A white without light, an unknown rule, a scale that is not positive.
    """
    xyz = checked_white(white)
    screen = as_display(display)
    linear = screen.linear_from_xyz @ xyz
    limit = int(np.argmax(linear))
    if rule == "fit":
        # The next number below: 1 / m may round up, and then m * (1 / m) exceeds full drive.
        scale = float(np.nextafter(1.0 / linear[limit], 0.0))
    elif rule == "luminance":
        scale = float(1.0 / xyz[1])
    else:
        try:
            scale = float(rule)
        except ValueError as error:
            raise ArgumentError(
                f'white: expected "fit", "luminance" or a scale, found {rule!r}'
            ) from error
        if not (np.isfinite(scale) and scale > 0):
            raise ArgumentError(f"white: expected a positive scale, found {scale:g}")
    shown = scale * linear
    return WhiteScale(
        scale=scale,
        channel=CHANNELS[limit],
        linear=shown,
        clipped=_channels(shown > 1.0),
        unreachable=_channels(shown < screen.curve.floor),
    )


def xyz_from_coefficients(
    basis: ArrayLike,
    wavelengths: ArrayLike,
    illuminant: Illuminant,
    *,
    observer: str = STANDARD_OBSERVER,
    test: Illuminant | None = None,
    reference: Illuminant | White = "D65",
    d: float | None = None,
    mode: Mode = "planck",
) -> XyzFold:
    """Fold basis, light, observer and adaptation into one matrix to XYZ.

    Parameters
    ----------
    basis
        ``(k, n)``: reflectance is ``coefficients @ basis``.
    wavelengths
        ``(n,)`` nm.
    illuminant
        The light on the painting, see :data:`Illuminant`; an array ``(n,)`` stands on
        ``wavelengths``.
    observer
        One of :data:`OBSERVERS`.
    test
        The light the eye compares with the reference; default: the illuminant.
    reference, d, mode
        See :func:`adaptation`. ``d=None``: no adaptation, the light is seen as it is.

    Raises
    ------
    ArgumentError
        A basis that is not finite ``(k, n)``, and whatever :func:`xyz_from_spectrum` and
        :func:`adaptation` refuse.
    """
    grid = checked_wavelengths(wavelengths)
    rows = checked_spectra(basis, grid, "basis", "k")
    operator = xyz_from_spectrum(grid, illuminant, observer)
    seen = None
    if d is not None:
        seen = adaptation(
            _on_grid(illuminant if test is None else test, grid),
            reference if isinstance(reference, White) else _on_grid(reference, grid),
            d,
            mode,
            observer=observer,
        )
        operator = seen.matrix @ operator
    return XyzFold(operator @ rows.T, operator.sum(axis=1), seen)


def display_from_coefficients(
    basis: ArrayLike,
    wavelengths: ArrayLike,
    illuminant: Illuminant,
    *,
    observer: str = STANDARD_OBSERVER,
    test: Illuminant | None = None,
    reference: Illuminant | White = "D65",
    d: float | None = None,
    mode: Mode = "planck",
    display: Display | str | Path = "srgb",
    white: Literal["fit", "luminance"] | float = "fit",
) -> Fold:
    """Fold basis, light, observer, adaptation, display and white scale into one matrix.

    Parameters
    ----------
    basis, wavelengths, illuminant, observer, test, d, mode
        See :func:`xyz_from_coefficients`.
    reference
        The same; also ``"display"``, the display's own white: an observer at a monitor of 7500 K
        who is fully adapted (d = 1, ``mode="anchored"``) then sees full drive as white.
    display
        A display, the name of a standard one, or its file (:func:`read_display`).
    white
        The rule of :func:`white_scale`.

    Returns
    -------
    Fold
        ``diffuse (3, k)`` and ``interface (3,)``, float64, in linear display light.
    """
    if isinstance(reference, str) and reference == "display":
        reference = as_display(display).white
    seen = xyz_from_coefficients(
        basis,
        wavelengths,
        illuminant,
        observer=observer,
        test=test,
        reference=reference,
        d=d,
        mode=mode,
    )
    return display_from_xyz(seen, display, white)


def display_from_xyz(
    seen: XyzFold,
    display: Display | str | Path = "srgb",
    white: Literal["fit", "luminance"] | float = "fit",
) -> Fold:
    """Continue a fold from XYZ to a display.

    Parameters
    ----------
    seen
        From :func:`xyz_from_coefficients`, or made by hand: any matrix from k numbers per pixel to
        XYZ, with the XYZ of white.
    display, white
        See :func:`white_scale`; ``seen.interface`` is the white.
    """
    screen = as_display(display)
    shown = white_scale(seen.interface, screen, white)
    matrix = shown.scale * screen.linear_from_xyz
    return Fold(matrix @ seen.diffuse, shown.linear, screen, shown, seen.adaptation)


def _on_grid(illuminant: Illuminant, grid: Floats) -> Illuminant:
    """Add the wavelengths to a bare array of values."""
    if isinstance(illuminant, str | tuple) or hasattr(illuminant, "wavelengths"):
        return illuminant
    return (grid, illuminant) if np.ndim(illuminant) == 1 else illuminant


def _channels(which: NDArray[np.bool_]) -> tuple[str, ...]:
    return tuple(name for name, hit in zip(CHANNELS, which, strict=True) if hit)
