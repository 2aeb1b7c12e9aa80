"""Directions as people say them: azimuth and elevation in degrees."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Any

from cyclopts import Parameter, Token


@dataclass(frozen=True, slots=True)
class Angles:
    """A direction away from the painting, in degrees.

    Parameters
    ----------
    azimuth
        0 is right, 90 up, 180 left, 270 (or -90) down.
    elevation
        0 grazes the painting, 90 stands straight in front of it.
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
        If these are not two finite numbers, or the direction lies behind the painting.
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


def _one(_type: Any, tokens: Sequence[Token]) -> Angles:
    return parsed(tokens[-1].value)


def _several(_type: Any, tokens: Sequence[Token]) -> tuple[Angles, ...]:
    return tuple(parsed(token.value) for token in tokens)


OneDirection = Annotated[
    Angles | None,
    Parameter(converter=_one, n_tokens=1, accepts_keys=False, allow_leading_hyphen=True),
]
SeveralDirections = Annotated[
    tuple[Angles, ...] | None,
    Parameter(
        converter=_several, n_tokens=1, accepts_keys=False, allow_leading_hyphen=True, negative=""
    ),
]
