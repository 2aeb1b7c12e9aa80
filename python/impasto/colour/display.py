"""Displays: from codes to light, and from colours to codes.

A display is a matrix and one tone curve per channel. Its black (the light at code 0 plus the room's
reflection on the screen) needs no third concept: it is a floor under each curve.

The matrix of the primaries is our own: colour-science's agrees to 1e-16, takes a second to import
and does not refuse primaries that lie on one line.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cache
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from impasto.colour.curves import Curve, GammaCurve, MeasuredCurve, SrgbCurve
from impasto.colour.observers import White, checked_white
from impasto.colour.wavelengths import Floats
from impasto.errors import ArgumentError

CHANNELS = ("red", "green", "blue")
D65_CHROMATICITY = (0.3127, 0.3290)
"""White of sRGB and Display P3, from their standards."""
NAMED_PRIMARIES = {
    "srgb": ((0.64, 0.33), (0.30, 0.60), (0.15, 0.06)),
    "display-p3": ((0.68, 0.32), (0.265, 0.69), (0.15, 0.06)),
}
"""Chromaticities (x, y) of red, green, blue: IEC 61966-2-1; SMPTE RP 431-2 with a D65 white."""
LARGEST_IMBALANCE = 0.25
"""Largest relative difference between red + green + blue and the measured white."""


@dataclass(frozen=True)
class DisplayCurve:
    """The three tone curves over their black floors.

    Attributes
    ----------
    channels
        Red, green, blue.
    floor
        ``(3,)`` linear light that each channel emits at code 0, full drive being 1.
    """

    channels: tuple[Curve, Curve, Curve]
    floor: Floats

    def encode(self, linear: ArrayLike) -> Floats:
        """Codes in [0, 1] from linear light, both ``(3, ...)``.

        Light below the floor or above 1 is clipped; NaN stays NaN.
        """
        light = _planar(linear, "linear")
        return np.stack(
            [
                curve.encode(np.clip((channel - floor) / (1.0 - floor), 0.0, 1.0))
                for curve, floor, channel in zip(self.channels, self.floor, light, strict=True)
            ]
        )

    def decode(self, code: ArrayLike) -> Floats:
        """Linear light from codes in [0, 1], both ``(3, ...)``."""
        codes = np.clip(_planar(code, "code"), 0.0, 1.0)
        return np.stack(
            [
                floor + (1.0 - floor) * curve.decode(channel)
                for curve, floor, channel in zip(self.channels, self.floor, codes, strict=True)
            ]
        )

    def table(self, n: int = 65536) -> NDArray[np.float32]:
        """Codes at ``n`` evenly spaced linear values from 0 to 1, for the renderer.

        Returns
        -------
        ndarray
            ``(3, n)`` float32 in [0, 1], never falling along a row.
        """
        if n < 2:
            raise ArgumentError(f"n: expected at least 2 entries, found {n}")
        light = np.broadcast_to(np.linspace(0.0, 1.0, n), (3, n))
        return self.encode(light).astype(np.float32)


@dataclass(frozen=True)
class Calibration:
    """Consistency of the measurements of a display.

    Attributes
    ----------
    peak_luminance
        Y of the measured white, in the unit of the measurement.
    black
        XYZ ``(3,)`` at code 0, white being Y = 1.
    balance
        ``(3,)`` factor on each primary that makes their sum the measured white: 1 for a display
        whose channels are independent.
    largest_fall
        Largest decrease of a ramp, as a share of its range.
    """

    peak_luminance: float
    black: Floats
    balance: Floats
    largest_fall: float


@dataclass(frozen=True, repr=False)
class Display:
    """A display: XYZ to linear light to codes.

    Attributes
    ----------
    name
        For reports.
    xyz_from_linear
        ``(3, 3)``; linear (1, 1, 1) is full drive and has Y = 1.
    curve
        Linear light to codes and back.
    calibration
        Present for a measured display.
    """

    name: str
    xyz_from_linear: Floats
    curve: DisplayCurve
    calibration: Calibration | None = None
    linear_from_xyz: Floats = field(init=False)
    """``(3, 3)``, the inverse."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "linear_from_xyz", np.linalg.inv(self.xyz_from_linear))

    def __repr__(self) -> str:
        return f"<Display {self.name}{', measured' * (self.calibration is not None)}>"

    @classmethod
    def named(cls, name: str) -> Display:
        """A standard display: ``"srgb"`` or ``"display-p3"`` (any case, spaces allowed).

        Raises
        ------
        ArgumentError
            Any other name.
        """
        key = name.casefold().strip().replace(" ", "-").replace("_", "-")
        if key not in NAMED_PRIMARIES:
            raise ArgumentError(
                f"display: expected {' or '.join(map(repr, NAMED_PRIMARIES))}, found {name!r}; "
                "any other display: Display.calibrated(...)"
            )
        return cls._standard(key)

    @classmethod
    @cache
    def _standard(cls, key: str) -> Display:
        """A display of :data:`NAMED_PRIMARIES`: every scene and picture has the same one."""
        matrix = _matrix_from_chromaticities(
            np.array(NAMED_PRIMARIES[key]), _xyz_from_xy(np.array(D65_CHROMATICITY))
        )
        curve = SrgbCurve()
        found = cls(key, matrix, DisplayCurve((curve, curve, curve), np.zeros(3)))
        for shared in (found.xyz_from_linear, found.linear_from_xyz, found.curve.floor):
            shared.setflags(write=False)
        return found

    @classmethod
    def calibrated(
        cls,
        *,
        white: ArrayLike,
        primaries: ArrayLike,
        black: ArrayLike | None = None,
        curve: Literal["srgb"] | float | Sequence[float] = "srgb",
        ramp: tuple[ArrayLike, ArrayLike] | None = None,
        name: str = "calibrated",
    ) -> Display:
        """A display from its measurements: the two-step calibration of the six-band paper.

        Parameters
        ----------
        white
            XYZ ``(3,)`` at full drive of all channels, in any unit (cd/m^2).
        primaries
            Red, green, blue at full drive, in rows: XYZ ``(3, 3)`` in the unit of ``white``
            (readings, so they contain the black), or chromaticities x, y ``(3, 2)``.
        black
            XYZ ``(3,)`` at code 0, in the unit of ``white``: leakage and the room's flare.
            Default: none.
        curve
            Where no ramp was measured: ``"srgb"``, one gamma, or one gamma per channel.
        ramp
            ``(codes, readings)``: codes ``(m,)`` from 0 to full drive, and one reading per code
            ``(m,)`` of the grey ramp or ``(3, m)`` of the three channels.
        name
            For reports.

        Raises
        ------
        ArgumentError
            Readings that are not finite, a black brighter than a tenth of the white, primaries
            that lie on a line or miss the white by more than 25 %, a ramp that falls.
        """
        full = checked_white(white, "white")
        dark = np.zeros(3) if black is None else _checked_black(black, full)
        above = full - dark
        colours = np.asarray(primaries, dtype=np.float64)
        if colours.shape not in {(3, 3), (3, 2)} or not np.isfinite(colours).all():
            raise ArgumentError(
                "primaries: expected finite XYZ (3, 3) or x, y (3, 2) with red, green, blue in "
                f"rows, found shape {colours.shape}"
            )
        if colours.shape == (3, 2):
            columns, balance = _matrix_from_chromaticities(colours, above), np.ones(3)
        else:
            columns, balance = _balanced((colours - dark).T, above)
        # XYZ = dark + columns @ f(code) = columns' @ (floor + (1 - floor) f(code)): the black moves
        # under the curves and full drive stays the measured white.
        drive = np.linalg.solve(columns, dark)
        floor = drive / (1.0 + drive)
        curves = _curves(curve, ramp)
        falls = [c.largest_fall for c in curves if isinstance(c, MeasuredCurve)]
        return cls(
            name,
            columns * (1.0 + drive) / full[1],
            DisplayCurve(curves, floor),
            Calibration(float(full[1]), dark / full[1], balance, max(falls, default=0.0)),
        )

    @property
    def white(self) -> White:
        """The colour at full drive, a reference for :func:`adaptation`."""
        x, y, z = self.xyz_from_linear.sum(axis=1).tolist()
        return White((x, y, z))

    def encode(self, linear: ArrayLike) -> Floats:
        """Codes in [0, 1] from linear light, ``(3, ...)``, by each channel's curve."""
        return self.curve.encode(linear)

    def decode(self, code: ArrayLike) -> Floats:
        """Linear light from codes in [0, 1], ``(3, ...)``."""
        return self.curve.decode(code)

    def table(self, n: int = 65536) -> NDArray[np.float32]:
        """``(3, n)`` codes at evenly spaced linear values, by each channel's curve."""
        return self.curve.table(n)

    def linear_of(self, xyz: ArrayLike) -> Floats:
        """Linear display light from XYZ, both ``(3, ...)``; not clipped."""
        return np.tensordot(self.linear_from_xyz, _planar(xyz, "xyz"), axes=1)

    def xyz_of(self, code: ArrayLike) -> Floats:
        """XYZ of codes in [0, 1], both ``(3, ...)``, including the black."""
        return np.tensordot(self.xyz_from_linear, self.decode(code), axes=1)


def _curves(
    curve: Literal["srgb"] | float | Sequence[float], ramp: tuple[ArrayLike, ArrayLike] | None
) -> tuple[Curve, Curve, Curve]:
    if ramp is not None:
        codes, readings = ramp
        light = np.asarray(readings, dtype=np.float64)
        if light.ndim not in {1, 2} or (light.ndim == 2 and light.shape[0] != 3):
            raise ArgumentError(
                f"ramp: expected readings (m,) or (3, m), found shape {light.shape}"
            )
        red, green, blue = np.broadcast_to(light, (3, light.shape[-1]))
        return (
            MeasuredCurve(codes, red),
            MeasuredCurve(codes, green),
            MeasuredCurve(codes, blue),
        )
    if isinstance(curve, str):
        if curve != "srgb":
            raise ArgumentError(f'curve: expected "srgb" or a gamma, found {curve!r}')
        return (SrgbCurve(), SrgbCurve(), SrgbCurve())
    gammas = np.asarray(curve, dtype=np.float64)
    if gammas.shape not in {(), (3,)}:
        raise ArgumentError(f"curve: expected one gamma or three, found shape {gammas.shape}")
    red, green, blue = np.broadcast_to(gammas, (3,)).tolist()
    return (GammaCurve(red), GammaCurve(green), GammaCurve(blue))


def _checked_black(black: ArrayLike, white: Floats) -> Floats:
    dark = np.asarray(black, dtype=np.float64)
    if dark.shape != (3,) or not np.isfinite(dark).all() or (dark < 0).any():
        raise ArgumentError(f"black: expected finite XYZ (3,) >= 0, found {dark}")
    if dark[1] > 0.1 * white[1]:
        raise ArgumentError(
            f"black: Y {dark[1]:g} is more than a tenth of the white's {white[1]:g}; "
            "the same unit? If the room is that bright, darken it: such a display shows no darks"
        )
    return dark


def _balanced(columns: Floats, white: Floats) -> tuple[Floats, Floats]:
    """Primaries scaled so that their sum is the white, and the factors."""
    balance = _solved(columns, white)
    if (np.abs(balance - 1.0) > LARGEST_IMBALANCE).any():
        raise ArgumentError(
            "primaries: red + green + blue miss the white; it would take "
            f"{np.round(balance, 3)} of them. One unit for all readings? Rows red, green, blue?"
        )
    return columns * balance, balance


def _matrix_from_chromaticities(chromaticities: Floats, white: Floats) -> Floats:
    columns = np.stack([_xyz_from_xy(xy) for xy in chromaticities], axis=1)
    amounts = _solved(columns, white)
    if (amounts <= 0).any():
        raise ArgumentError(
            f"primaries: the white lies outside their triangle (amounts {np.round(amounts, 4)})"
        )
    return columns * amounts


def _solved(columns: Floats, white: Floats) -> Floats:
    if not np.linalg.cond(columns) < 1e6:
        raise ArgumentError("primaries: they lie on one line and span no colour triangle")
    return np.asarray(np.linalg.solve(columns, white), dtype=np.float64)


def _xyz_from_xy(xy: Floats) -> Floats:
    x, y = xy
    if not y > 0:
        raise ArgumentError(f"primaries: expected chromaticities with y > 0, found {x:g}, {y:g}")
    return np.array([x / y, 1.0, (1.0 - x - y) / y])


def _planar(values: ArrayLike, name: str) -> Floats:
    array = np.asarray(values, dtype=np.float64)
    if array.ndim == 0 or array.shape[0] != 3:
        raise ArgumentError(f"{name}: expected shape (3, ...), found {array.shape}")
    return array
