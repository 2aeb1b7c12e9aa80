"""A picture of what a monochromator told: sensitivities, what leaks, errors, and the lit area."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from impasto.calibrate.monochromator import PASSED, MonochromatorCamera
from impasto.pictures import Panel, Picture, Series, contact_sheet, diagram_panel
from impasto.pictures.diagrams import AMBER, BLUE, GREEN, GROUND, LINE, RED
from impasto.pictures.sheet import fitted

_SIZE = 460
_FAINTEST = -4.0
"""Logarithm of the least sensitivity that is shown, relative to the largest."""
_MANY = (RED, GREEN, BLUE, AMBER, (190, 140, 230), (110, 200, 210))


def monochromator_picture(found: MonochromatorCamera) -> Picture:
    """``(y, x, 3)``: sensitivities, their logarithms, standard deviations, and what was read.

    Parameters
    ----------
    found
        What :func:`impasto.calibrate.camera_from_monochromator` returned.
    """
    peak = found.sensitivities.max(axis=1, keepdims=True)
    curves, spread = found.sensitivities / peak, 100.0 * found.sigma / peak
    colours = [_MANY[number % len(_MANY)] for number in range(len(found.names))]
    nm = found.wavelengths
    x, axis = (float(nm[0]), float(nm[-1])), (f"{nm[0]:g} nm", f"{nm[-1]:g}")

    def drawn(values: np.ndarray, *, dots: bool) -> list[Series]:
        return [
            Series("" if dots else name, np.stack([nm, one], axis=1), colour, dots=dots)
            for name, one, colour in zip(found.names, values, colours, strict=True)
        ]

    faint = np.log10(np.maximum(curves, 10.0**_FAINTEST))
    limit = Series("", [(x[0], np.log10(PASSED)), (x[1], np.log10(PASSED))], LINE)
    # Colours have their names in the first diagram; here they would lie on the curves.
    unnamed = [replace(one, name="") for one in drawn(faint, dots=False)]
    leaky = int(found.leakage[:, 0].argmax())
    worst = f"{100 * found.leakage[leaky, 0]:.2g} % {found.names[leaky]}"
    panels = [
        diagram_panel(
            drawn(curves, dots=False) + drawn(curves, dots=True), "Sensitivities",
            x=x, y=(0.0, 1.6), axis=axis, note="largest = 1", size=(_SIZE, _SIZE),
        ),
        diagram_panel(
            [limit, *unnamed], "Their logarithms",
            x=x, y=(_FAINTEST, 0.0), axis=axis, note=f"outside: {worst}", size=(_SIZE, _SIZE),
        ),
        diagram_panel(
            drawn(spread, dots=False), "Standard deviations",
            x=x, y=(0.0, _round(1.3 * float(spread.max()))), axis=axis, note="% of the largest",
            size=(_SIZE, _SIZE),
        ),
        _area(found),
    ]  # fmt: skip
    count = len(found.reading.names)
    return contact_sheet(
        panels, title="Camera from a monochromator",
        subtitle=f"{count} photographs, {len(nm)} wavelengths", columns=2,
    )  # fmt: skip


def _round(top: float) -> float:
    """A little more than a number, of which a quarter has one digit."""
    quarter = max(top, 1e-6) / 4.0
    unit = 10.0 ** np.floor(np.log10(quarter))
    return float(4.0 * unit * np.ceil(quarter / unit))


def _area(found: MonochromatorCamera) -> Panel:
    lit = found.reading.lit
    rgb = np.empty((*lit.shape, 3), dtype=np.uint8)
    rgb[:] = GROUND
    rgb[lit] = AMBER
    return Panel("What was read", fitted(rgb, _SIZE, _SIZE), f"{int(lit.sum())} pixels")
