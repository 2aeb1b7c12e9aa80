"""Clipped, black, missing and blank samples."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from impasto._internal.wording import counted
from impasto.doctor.diagnosis import Finding, named
from impasto.doctor.sampled_tiles import linear
from impasto.stack import Stack

Floats = NDArray[np.float64]

_TORN = 0.04
"""Share of rows of one value, above the median of the stack, that indicates damage."""
_BESIDE = 0.05
"""Rows whose median maximum is below this share of the brightest row's are background."""
_PIXELS = 200_000
"""Pixels examined in each photograph; a larger one is read on an even grid."""


@dataclass(frozen=True, eq=False)
class Exposure:
    """Shares ``(obs, band)`` of the painting's samples, and levels in linear light.

    Attributes
    ----------
    clipped, dark, missing
        Share of samples at the saturation level, at black, and not finite.
    median, high
        Median and 99th percentile of the usable samples, as a share of full scale.
    piled
        Share of samples that equal the photograph's largest one but are not marked as clipped.
    peak
        The largest stored value.
    blank
        ``(obs,)`` share of rows that hold one value only, but not in the other photographs.
    """

    clipped: Floats
    dark: Floats
    missing: Floats
    median: Floats
    high: Floats
    piled: Floats
    peak: Floats
    blank: Floats

    @classmethod
    def of(cls, stack: Stack) -> Exposure:
        """Measure every photograph."""
        observations, bands, height, width = stack.shape
        step = max(1, int(np.ceil(np.sqrt(height * width / _PIXELS))))
        grid = np.s_[:, ::step, ::step]
        inside = None if stack.mask is None else stack.mask[grid[1:]]
        if inside is not None and not inside.any():
            inside = None
        full, floor = _full_scale(stack), _black_level(stack)
        table = np.full((7, observations, bands), np.nan)
        rows = range(0, height, step)
        blank, top = np.zeros((observations, len(rows)), bool), np.zeros((observations, len(rows)))
        for index in range(observations):
            stored = stack.samples[index][grid]
            blank[index] = (stored == stored[:, :, :1]).all(axis=(0, 2))
            top[index] = np.nan_to_num(stored).max(axis=(0, 2))
            stored = stored.reshape(bands, -1) if inside is None else stored[:, inside]
            value = linear(stack, stored)
            for band in range(bands):
                table[:, index, band] = _measure(
                    stored[band], value[band], float(full[band]), float(floor[band])
                )
        clipped, dark, missing, median, high, piled, peak = table
        # Rows beside the painting are black in all photographs: blank is no fault there.
        usual = np.median(top, axis=0)
        shown = usual > _BESIDE * usual.max()
        return cls(clipped, dark, missing, median, high, piled, peak, (blank & shown).mean(axis=1))


def _full_scale(stack: Stack) -> Floats:
    """``(band,)`` linear light at the saturation level; NaN if unknown."""
    if stack.saturation is None:
        return np.full(len(stack.bands), np.nan)
    level = (stack.saturation - stack.black) * stack.scale
    return np.where(np.isfinite(level), level, np.nan)


def _black_level(stack: Stack) -> Floats:
    """``(band,)`` linear light below which a sample is mostly noise."""
    if stack.encoding.white == 255.0 or stack.samples.dtype == np.uint8:
        share = float(stack.encoding.decode(3.0 / 255.0 * stack.encoding.white))
    else:
        share = 0.002
    full = _full_scale(stack)
    return np.asarray(share * np.where(np.isfinite(full), full, 1.0))


def _measure(
    stored: NDArray[np.generic], value: NDArray[np.float32], full: float, floor: float
) -> list[float]:
    clipped = np.isposinf(value)
    usable = np.isfinite(value)
    count = max(len(value), 1)
    result = [
        float(clipped.sum()) / count,
        float((value[usable] <= floor).sum()) / count,
        float((~usable & ~clipped).sum()) / count,
        np.nan,
        np.nan,
        0.0,
        np.nan,
    ]
    if usable.any():
        middle, high = np.percentile(value[usable], (50.0, 99.0)) / full
        peak = stored[usable].max()
        result[3:] = [middle, high, float((stored[usable] == peak).sum()) / count, float(peak)]
    return result


def exposure(stack: Stack, measured: Exposure) -> list[Finding]:
    """Saturation, an unmarked clipping level, darkness, missing samples, blank rows."""
    return [
        *_missing(stack, measured),
        _saturation(stack, measured),
        *_plateau(stack, measured),
        *_darkness(stack, measured),
        *_blank(stack, measured),
    ]


def _saturation(stack: Stack, measured: Exposure) -> Finding:
    share = measured.clipped.mean(axis=0)
    total = float(share.mean())
    worst_band = int(share.argmax())
    per_photograph = measured.clipped.max(axis=1)
    heavy = np.flatnonzero(per_photograph > 0.25).tolist()
    numbers = {
        "share": round(total, 6),
        "bands": dict(zip(stack.bands, np.round(share, 6).tolist(), strict=True)),
    }
    text = f"{100 * total:.2f} % of the samples are clipped"
    if share.max() > 0:
        text += f" (most in {stack.bands[worst_band]}: {100 * share[worst_band]:.2f} %)"
    if total > 0.99:
        return Finding(
            "saturation",
            "error",
            f"{text}: nothing can be measured",
            "expose less, or give the code from which samples are clipped: saturation=",
            numbers=numbers,
        )
    if heavy or total > 0.05:
        more = (
            f"; more than a quarter of {counted(len(heavy), 'photograph')} is "
            f"({named(stack.names, heavy)})"
            if heavy
            else ""
        )
        return Finding(
            "saturation",
            "warning",
            text + more,
            "clipped samples are left out, which costs accuracy: expose these photographs less, or "
            "merge an exposure series to 16 bit or OpenEXR",
            tuple(heavy),
            numbers=numbers,
        )
    if total > 0.005:
        return Finding(
            "saturation",
            "note",
            text,
            "they are left out of every fit; highlights lose their peaks",
            numbers=numbers,
        )
    return Finding("saturation", "ok", text, numbers=numbers)


def _plateau(stack: Stack, measured: Exposure) -> list[Finding]:
    """A common maximum of many photographs that many samples have is a clipping level."""
    found = []
    for band, name in enumerate(stack.bands):
        peak, piled = measured.peak[:, band], measured.piled[:, band]
        level = float(np.nanmax(peak)) if np.isfinite(peak).any() else np.nan
        at_level = np.flatnonzero((peak == level) & (piled > 2e-3))
        if len(at_level) < max(2, len(peak) // 10) or not level > 0:
            continue
        if stack.saturation is not None and level > 0.98 * stack.saturation[band]:
            # JPEG spreads clipped samples over the codes just below full scale.
            continue
        share = float(piled[at_level].mean())
        found.append(
            Finding(
                "plateau",
                "warning",
                f"in {name}, {counted(len(at_level), 'photograph')} end at exactly {level:g} with "
                f"{100 * share:.1f} % of their samples there: clipped, but not marked as such",
                f"give saturation={level:g} (for coded files, the code in the file)",
                tuple(at_level.tolist()),
                numbers={"band": name, "level": level, "share": round(share, 5)},
            )
        )
    return found


def _darkness(stack: Stack, measured: Exposure) -> list[Finding]:
    dark = measured.dark.min(axis=1)
    share = float(measured.dark.mean())
    numbers = {"share": round(share, 6)}
    text = f"{100 * share:.1f} % of the samples are black or nearly black"
    if dark.min() > 0.99:
        return [
            Finding(
                "darkness",
                "error",
                f"{text}: there is no signal",
                "expose more; check dark= and the black level, which are subtracted",
                numbers=numbers,
            )
        ]
    found = []
    black = np.flatnonzero(dark > 0.98).tolist()
    if black:
        found.append(
            Finding(
                "unlit",
                "warning",
                f"{counted(len(black), 'photograph')} completely black "
                f"({named(stack.names, black)}): the lamp did not fire",
                "photograph again, or remove these lines from the light file",
                tuple(black),
                numbers=numbers,
            )
        )
    rest = np.delete(measured.high, black, axis=0)
    coded_linear = stack.encoding.curve == "linear"
    if coded_linear and np.isfinite(rest).any() and float(np.nanmax(rest)) < 0.05:
        found.append(
            Finding(
                "darkness",
                "warning",
                f"underexposed: the brightest photograph reaches {100 * np.nanmax(rest):.1f} % of "
                "full scale (99th percentile), so noise and quantisation are large",
                "expose more, or give saturation= if the files hold fewer bits than their type",
                numbers=numbers | {"brightest": round(float(np.nanmax(rest)), 5)},
            )
        )
    elif share > 0.6:
        found.append(
            Finding(
                "darkness", "warning", text, "expose more, or use brighter lights", numbers=numbers
            )
        )
    else:
        severity = "note" if share > 0.25 else "ok"
        found.append(
            Finding("darkness", "note" if severity == "note" else "ok", text, numbers=numbers)
        )
    return found


def _missing(stack: Stack, measured: Exposure) -> list[Finding]:
    if stack.mask is not None and not stack.mask.any():
        return [
            Finding(
                "mask",
                "error",
                "the mask is empty: no pixel belongs to the painting",
                "the painting is where the mask is not 0; give another mask=",
            )
        ]
    share = float(measured.missing.mean())
    if share == 0.0:
        return []
    empty = np.flatnonzero(measured.missing.min(axis=1) > 0.999).tolist()
    everything = len(empty) == len(stack.rig)
    text = f"{100 * share:.2f} % of the samples are not numbers (NaN)"
    if empty:
        text += f"; only NaN in {named(stack.names, empty)}"
    return [
        Finding(
            "missing-samples",
            "error" if everything else "warning" if empty or share > 0.05 else "note",
            text,
            "they are left out of every fit; with white=, the board is clipped, black or shaded "
            "there",
            tuple(empty),
            numbers={"share": round(share, 6)},
        )
    ]


def _blank(stack: Stack, measured: Exposure) -> list[Finding]:
    """Decoders fill the remainder of a damaged picture with one value; JPEG ones do so silently."""
    usual = float(np.median(measured.blank))
    whole = measured.dark.min(axis=1) > 0.98
    torn = np.flatnonzero((measured.blank > usual + _TORN) & ~whole & (stack.shape[3] > 1)).tolist()
    if not torn:
        return []
    share = float(measured.blank[torn].max())
    return [
        Finding(
            "blank",
            "warning",
            f"{counted(len(torn), 'photograph')} with up to {100 * share:.0f} % of the rows of one "
            f"value ({named(stack.names, torn)}): damaged files, filled by the decoder",
            "copy them again from the camera, or remove these lines from the light file",
            tuple(torn),
            numbers={"share": round(share, 4)},
        )
    ]
