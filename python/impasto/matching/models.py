"""What models of chromatic adaptation predict of the same match, by colour-science.

CAT16 [@li2017cam16] with its own degree of adaptation in a dark room, von Kries' transform with
complete adaptation [@vonkries1902], and that of the CIE, which is Nayatani's [@cie1994adaptation].
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from impasto.colour import STANDARD_OBSERVER, White, adaptation, delta_e, lab_from_xyz, white_point
from impasto.colour._science import science
from impasto.colour.adaptation import Mode
from impasto.colour.temperature import correlated
from impasto.errors import ArgumentError

Floats = NDArray[np.float64]
Transform = Callable[[Floats], Floats]

WHITE_LUMINANCE = 60.0
"""cd/m2 of white under the lamp and on the display, as in the paper."""
BACKGROUND = 0.2
"""Its luminance relative to white, grey as models take it where nothing is said."""
FINE = np.linspace(0.0, 1.0, 101)
"""Degrees among which the one that is nearest to a model is looked for."""


@dataclass(frozen=True)
class ModelMatch:
    """A model in terms of the paper's degree d.

    Attributes
    ----------
    name
        Of the model.
    white_degree
        The d whose adapted white has the colour temperature of the model's (eq. 7 solved for d).
    degree
        The d whose colours of the painting are nearest to the model's, in mean dE00.
    delta_e
        That mean: how far the model's colours are from any d.
    chosen_delta_e
        The mean dE00 between the model's colours and those of the observers' mean d.
    within
        Whether ``degree`` lies within the interval of the observers' mean.
    """

    name: str
    white_degree: float
    degree: float
    delta_e: float
    chosen_delta_e: float
    within: bool


def transforms(illuminant: str | float, reference: str | float) -> dict[str, Transform]:
    """XYZ ``(3, n)`` under the lamp to corresponding colours under the reference, by model."""
    tools = science()
    test, other = white_point(illuminant), white_point(reference)
    xy_test, xy_other = tools.XYZ_to_xy(test), tools.XYZ_to_xy(other)
    dark = tools.VIEWING_CONDITIONS_CIECAM16["Dark"].F
    luminance = WHITE_LUMINANCE * BACKGROUND
    degree = tools.appearance.ciecam02.degree_of_adaptation(dark, luminance)
    lux = np.pi * WHITE_LUMINANCE

    def cat16(xyz: Floats) -> Floats:
        found = tools.adaptation.chromatic_adaptation_Zhai2018(
            100.0 * xyz.T, 100.0 * test, 100.0 * other, degree, 1.0, 100.0 * other, "CAT16"
        )
        return np.asarray(found, np.float64).T / 100.0

    def von_kries(xyz: Floats) -> Floats:
        found = tools.adaptation.chromatic_adaptation_VonKries(xyz.T, test, other, "Von Kries")
        return np.asarray(found, np.float64).T

    def cie1994(xyz: Floats) -> Floats:
        found = tools.adaptation.chromatic_adaptation_CIE1994(
            100.0 * xyz.T, xy_test, xy_other, 100.0 * BACKGROUND, lux, lux
        )
        return np.asarray(found, np.float64).T / 100.0

    return {
        f"CAT16, dark room (D = {float(degree):.2f})": cat16,
        "von Kries, complete": von_kries,
        "CIE 1994 (Nayatani)": cie1994,
    }


def matches(
    xyz: Floats,
    illuminant: str | float,
    reference: str | float,
    mode: Mode,
    mean: float,
    interval: tuple[float, float],
) -> tuple[ModelMatch, ...]:
    """Every model against the observers.

    Parameters
    ----------
    xyz
        ``(3, n)`` colours under the lamp, white at Y = 1.
    illuminant, reference, mode
        Of the experiment.
    mean, interval
        Of the observers' degrees.
    """
    white = white_point(reference)

    def seen(d: float) -> Floats:
        return adaptation(illuminant, reference, d, mode).matrix @ xyz

    def lab(colours: Floats) -> Floats:
        return lab_from_xyz(np.maximum(colours, 0.0), white)

    by_degree = [lab(seen(float(d))) for d in FINE]
    chosen = lab(seen(mean))
    found = []
    for name, transform in transforms(illuminant, reference).items():
        own = lab(transform(xyz))
        off = [float(np.mean(delta_e(own, other))) for other in by_degree]
        best = int(np.argmin(off))
        found.append(
            ModelMatch(
                name=name,
                white_degree=_white_degree(transform, illuminant, reference),
                degree=float(FINE[best]),
                delta_e=off[best],
                chosen_delta_e=float(np.mean(delta_e(own, chosen))),
                within=bool(interval[0] <= FINE[best] <= interval[1]),
            )
        )
    return tuple(found)


def _white_degree(transform: Transform, illuminant: str | float, reference: str | float) -> float:
    """Eq. 7 for d, from the colour temperature of the white that a model shows; NaN: none."""
    shown = transform(white_point(illuminant)[:, None])[:, 0]
    x, y, z = shown.tolist()
    try:
        kelvin = correlated(White((x, y, z)), STANDARD_OBSERVER, "white")
    except ArgumentError:  # too coloured for a temperature
        return float("nan")
    mired = [
        1e6 / correlated(one, STANDARD_OBSERVER, "white").temperature
        for one in (illuminant, reference)
    ]
    return (1e6 / kelvin.temperature - mired[0]) / (mired[1] - mired[0])
