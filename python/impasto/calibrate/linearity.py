"""The tone curve of a camera from grey patches of one exposure, or from a series of exposures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impasto.calibrate.tone_response import Floats, Response, fit_response
from impasto.calibrate.tone_samples import Samples, exposure_samples, patch_samples
from impasto.encoding import Encoding
from impasto.errors import ArgumentError
from impasto.io.notes import few
from impasto.io.tone_curve import write_tone_curve

COVERED = 0.4
"""Share of the codes that a series must cover."""
FEWEST = 5
"""Samples that are not clipped; a smooth curve alone has three numbers."""
CONTRADICTS = 0.08
"""Relative error of a patch or an exposure from which the series contradicts itself ..."""
ODD = 0.02
"""... and from which it is named."""
CURVES = ("linear", "srgb", "1.8", "2", "2.2", "2.4")
"""Known curves that the measured one is compared with."""


@dataclass(frozen=True, eq=False)
class ToneCurve:
    """A measured tone curve.

    Parameters
    ----------
    response
        Codes, light and its standard deviation.
    samples
        What was read.
    measured
        Lowest and highest code that was used, as shares of full scale; beyond, the curve is
        extrapolated.
    nearest
        The known curve that is nearest, such as ``"srgb"``.
    deviation
        Its largest difference within ``measured``, as a share of the light at the highest code.
    nonlinearity
        The same of a straight line through black.
    findings
        What is odd, one sentence each.
    """

    response: Response
    samples: Samples
    measured: tuple[float, float]
    nearest: str
    deviation: float
    nonlinearity: float
    findings: tuple[str, ...]

    @property
    def nearest_words(self) -> str:
        """The nearest known curve for people: a number is a gamma."""
        return self.nearest if self.nearest.isalpha() else f"gamma {self.nearest}"

    @property
    def sigma(self) -> float:
        """Largest standard deviation within ``measured``, relative to the light at its end."""
        low, high = self.measured
        inside = (self.response.codes >= low) & (self.response.codes <= high)
        top = float(self.response(np.array([high]))[0])
        return float(self.response.sigma[inside].max(initial=0.0)) / top

    def save(self, path: str | Path) -> None:
        """Write the file that ``encoding=`` of :func:`impasto.read_stack` takes (``.json``)."""
        found = self.response
        about: dict[str, Any] = {
            "sigma": found.sigma.tolist(),
            "measured": list(self.measured),
            "series": self.samples.series,
            "nearest": self.nearest,
            "deviation": self.deviation,
            "nonlinearity": self.nonlinearity,
            "findings": list(self.findings),
        }
        write_tone_curve(path, found.codes, found.light, about)


def tone_from_patches(
    photograph: str | Path,
    patches: str | Path,
    *,
    dark: float | None = None,
    saturation: float | None = None,
) -> ToneCurve:
    """The tone curve from grey patches under even light, in one photograph.

    Parameters
    ----------
    photograph
        The file; its own tone curve is not used.
    patches
        A CSV file with the header ``column,row,size,reflectance``: the middle of each patch and the
        side of the square that is read, in pixels, and the reflectance.
    dark
        Code of black.
    saturation
        Code from which samples are clipped; default: the largest.

    Raises
    ------
    ArgumentError
        Too few patches that are not clipped, or patches that contradict each other, with their
        lines.
    CorruptInputError
        A damaged file.
    """
    return _curve(patch_samples(Path(photograph), Path(patches), dark, saturation))


def tone_from_exposures(
    folder: str | Path,
    *,
    times: Sequence[float] | None = None,
    dark: float | None = None,
    saturation: float | None = None,
) -> ToneCurve:
    """The tone curve from photographs of anything that stands still, by several exposure times.

    Parameters
    ----------
    folder
        The photographs: same light, aperture and sensitivity.
    times
        Exposure times in any unit, in the order of the names; default: those of EXIF, whose rounded
        values (1/60 s for 1/64 s) are taken for the nearest third of a stop.
    dark
        Code of black.
    saturation
        Code from which samples are clipped; default: the largest.

    Raises
    ------
    ArgumentError
        Fewer than three exposures, times that are not known, photographs that are clipped, or
        exposures that contradict each other, by name.
    CorruptInputError
        A damaged photograph.
    """
    return _curve(exposure_samples(Path(folder), times, dark, saturation))


def _curve(samples: Samples) -> ToneCurve:
    codes, light = samples.codes, samples.light
    if len(codes) < FEWEST:
        raise ArgumentError(
            f"{samples.source}: {len(codes)} samples are neither clipped nor black, {FEWEST} are "
            f"the least; {samples.advice}"
        )
    low, high = float(codes.min()), float(codes.max())
    if high - low < COVERED:
        raise ArgumentError(
            f"{samples.source}: codes from {100 * low:.0f} to {100 * high:.0f} % of full scale say "
            f"little of the curve, {100 * COVERED:.0f} % are the least; {samples.advice}"
        )
    response = fit_response(codes, light, samples.group, samples.black)
    findings = _contradictions(samples, response)
    if high < 0.95:
        findings.append(f"codes above {100 * high:.0f} % of full scale are extrapolated")
    grid = np.linspace(low, high, 200)
    nearest = min(CURVES, key=lambda name: _deviation(name, grid, response))
    return ToneCurve(
        response, samples, (low, high), nearest, _deviation(nearest, grid, response),
        _deviation("linear", grid, response), tuple(findings),
    )  # fmt: skip


def _deviation(name: str, grid: Floats, response: Response) -> float:
    """Largest difference after the best factor, relative to the last light."""
    known = Encoding(name).decode(grid).astype(np.float64)
    black = response.black
    if black > 0.0:
        known = known - float(
            np.interp(black, response.light, Encoding(name).decode(response.codes))
        )
    own = response(grid) - black
    factor = float(known @ own) / float(known @ known)
    return float(np.abs(own - factor * known).max() / own[-1])


def _contradictions(samples: Samples, response: Response) -> list[str]:
    """Items whose light is not what they are said to be; refused where it is far off."""
    count = len(samples.items)
    off = np.array(
        [
            np.median(response.residual[samples.item == i]) if (samples.item == i).any() else 0.0
            for i in range(count)
        ]
    )
    bad = np.flatnonzero(np.abs(off) > CONTRADICTS)
    if len(bad):
        named = few([f"{samples.items[i]} by {100 * off[i]:+.0f} %" for i in bad.tolist()])
        raise ArgumentError(
            f"{samples.source}: no tone curve explains the series: off is {named}; {samples.doubt}"
        )
    return [
        f"{samples.items[i]}: its light is off by {100 * off[i]:+.1f} % ({samples.doubt})"
        for i in np.flatnonzero(np.abs(off) > ODD).tolist()
    ]


def points_of(found: ToneCurve) -> NDArray[np.float64]:
    """``(n, 2)``: codes and the light that the series says they have, on the curve's scale."""
    samples = found.samples
    light = found.response.scales[samples.group] * samples.light + found.response.black
    return np.stack([samples.codes, light], axis=1)
