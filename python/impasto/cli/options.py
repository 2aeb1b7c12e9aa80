"""Types of options: flags, directions in degrees, positions in mm."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Any, TypeAlias

from cyclopts import Parameter, Token

from impasto.errors import ArgumentError

Position: TypeAlias = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class Angles:
    """A direction away from the painting, in degrees.

    Parameters
    ----------
    azimuth
        0 is right, 90 up, 180 left, 270 (or -90) down.
    elevation
        0 is in the plane of the painting, 90 in front of it.
    """

    azimuth: float
    elevation: float

    @property
    def direction(self) -> tuple[float, float, float]:
        """Unit vector (x, y, z): x right, y up, z towards the viewer."""
        azimuth, elevation = math.radians(self.azimuth), math.radians(self.elevation)
        across = math.cos(elevation)
        return (across * math.cos(azimuth), across * math.sin(azimuth), math.sin(elevation))

    def __str__(self) -> str:
        return f"{self.azimuth:g},{self.elevation:g}"


def parsed(text: str) -> Angles:
    """Angles from ``"azimuth,elevation"``.

    Raises
    ------
    ValueError
        If there are not two finite numbers, or the direction is behind the painting.
    """
    words = text.split(",")
    try:
        azimuth, elevation = (float(word) for word in words)
    except ValueError:
        raise ValueError(
            f"expected azimuth,elevation in degrees such as 45,30; found {text!r}"
        ) from None
    if not math.isfinite(azimuth) or not 0.0 < elevation <= 90.0:
        raise ValueError(f"expected an elevation above 0 and up to 90 degrees, found {text!r}")
    return Angles(azimuth, elevation)


WHITES = {"warm": 2700.0, "cool": 4000.0}
"""Kelvin of lamps sold as warm white and cool white (nominal temperatures of ANSI C78.377)."""


@dataclass(frozen=True, slots=True)
class Lamp:
    """Where a lamp stands, and its illuminant if it has one of its own."""

    angles: Angles
    illuminant: str | float | None = None


def lamp(text: str) -> Lamp:
    """A lamp from ``"azimuth,elevation"`` or ``"azimuth,elevation,illuminant"``.

    The illuminant is a name, kelvin, ``warm`` or ``cool``.

    Raises
    ------
    ValueError
        If these are not two finite numbers and an illuminant, or the direction is behind the
        painting.
    """
    words = text.split(",", 2)
    own: str | float | None = None
    if len(words) == 3:
        from impasto.colour.illuminants import checked_illuminant

        name = words.pop().strip()
        own = WHITES.get(name.lower(), name)
        try:
            checked_illuminant(own)
        except ArgumentError as error:
            found = str(error).removeprefix("illuminant: ")
            raise ValueError(f"{text!r}: {found}; or warm, cool") from None
    return Lamp(parsed(",".join(words)), own)


def position(text: str) -> Position:
    """Millimetres from ``"x,y,z"``.

    Raises
    ------
    ValueError
        If there are not three finite numbers.
    """
    try:
        x, y, z = (float(word) for word in text.split(","))
    except ValueError:
        raise ValueError(f"expected x,y,z in mm such as 0,300,800; found {text!r}") from None
    if not all(map(math.isfinite, (x, y, z))):
        raise ValueError(f"expected three finite numbers, found {text!r}")
    return (x, y, z)


def _one(_type: Any, tokens: Sequence[Token]) -> Angles:
    return parsed(tokens[-1].value)


def span(text: str) -> tuple[float, float]:
    """Two degrees of adaptation from ``"0..1"``.

    Raises
    ------
    ValueError
        If these are not two numbers from 0 to 1.
    """
    try:
        first, last = (float(word) for word in text.split(".."))
    except ValueError:
        raise ValueError(f"expected two degrees such as 0..1, found {text!r}") from None
    if not (0.0 <= first <= 1.0 and 0.0 <= last <= 1.0):
        raise ValueError(f"expected two degrees from 0 to 1, found {text!r}")
    return first, last


def _span(_type: Any, tokens: Sequence[Token]) -> tuple[float, float]:
    return span(tokens[-1].value)


def _lamps(_type: Any, tokens: Sequence[Token]) -> tuple[Lamp, ...]:
    return tuple(lamp(token.value) for token in tokens)


def _whole(_type: Any, tokens: Sequence[Token]) -> int:
    """A whole number; Cyclopts would round 1.5 to 2."""
    word = tokens[-1].value
    try:
        return int(word)
    except ValueError:
        raise ValueError(f"expected a whole number, found {word!r}") from None


def _position(_type: Any, tokens: Sequence[Token]) -> Position:
    return position(tokens[-1].value)


def _positions(_type: Any, tokens: Sequence[Token]) -> tuple[Position, ...]:
    return tuple(position(token.value) for token in tokens)


def _word(converter: Any, metavar: str) -> Parameter:
    """One argument, which may begin with a minus sign."""
    return Parameter(
        converter=converter,
        metavar=metavar,
        n_tokens=1,
        accepts_keys=False,
        allow_leading_hyphen=True,
        negative="",
    )


def check_threads(threads: int | None) -> None:
    """Refuse an invalid number of threads (option or environment) before any file is read."""
    from impasto._internal.calls import thread_count

    if threads is not None and threads < 1:
        raise ArgumentError(f"--threads: expected a number from 1 on, found {threads}")
    thread_count(threads)


Flag = Annotated[bool, Parameter(negative="", show_default=False)]
Whole = Annotated[int, Parameter(converter=_whole)]
SomeWhole = Annotated[int | None, Parameter(converter=_whole)]
OneDirection = Annotated[Angles | None, _word(_one, "AZ,EL")]
OnePosition = Annotated[Position | None, _word(_position, "X,Y,Z")]
OneSpan = Annotated[tuple[float, float] | None, _word(_span, "FROM..TO")]
SeveralLamps = Annotated[tuple[Lamp, ...] | None, _word(_lamps, "AZ,EL[,ILLUMINANT]")]
SeveralPositions = Annotated[tuple[Position, ...] | None, _word(_positions, "X,Y,Z")]
