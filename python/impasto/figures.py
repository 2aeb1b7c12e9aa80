"""The figures of the papers that are no renderings: maps, spectra, highlights."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from impasto.fit.lafortune import LafortuneSbrdf
from impasto.fit.reflectance import Reflectance
from impasto.highlights import just_not_overexposed, reconstruct_highlights
from impasto.overview import diffuse_panel, gloss_panel
from impasto.pictures import Panel, Picture, colour_panel, contact_sheet, normal_panel
from impasto.pictures.diagrams import (
    AMBER,
    BLUE,
    GREEN,
    RED,
    Series,
    bar_panel,
    diagram_panel,
    needle_panel,
)
from impasto.stack import Stack

if TYPE_CHECKING:
    from impasto.simulate import Truth
    from impasto.systems import System

CHANNELS = (RED, GREEN, BLUE)
NAMES = ("red", "green", "blue")

AREA = 1.0 / 16.0
"""Side of an area whose spectrum is shown, as a share of the picture's shorter side."""

Corner = tuple[int, int, int]
"""Row, column and side of an area in pixels."""


def specular_component(stack: Stack, sbrdf: Any) -> NDArray[np.float32]:
    """``(band, y, x)``: the brightest photograph of each pixel less its diffuse part.

    ``rho_S = rho_M - rho_D`` (RGB paper, section 5.2; six-band paper, before eq. 6). Brightness is
    the mean of the bands; photographs that are clipped in a band do not count. NaN where no
    photograph is left.
    """
    matte = replace(sbrdf.surface(), lobes=(), ambient=None, origin=stack.rig.origin)
    return just_not_overexposed(stack, less=lambda index: matte.predict(stack.rig.take([index]))[0])


def figures(
    system: System,
    stack: Stack,
    sbrdf: Any,
    reflectance: Reflectance | None = None,
    *,
    truth: Truth | None = None,
) -> dict[str, Picture]:
    """The paper's figures of a measured painting, by number; renderings are ``system.render``'s.

    ==============================  ==============================================================
    ``tominaga-rgb-camera``         ``figure-8`` normals; ``figure-9`` four areas; ``figure-10``
                                    their spectra; ``figure-11`` specular component only
    ``tominaga-six-band-...``       ``figure-2`` specular component against phi; ``figure-5``
                                    needle map of the normals; ``figure-6`` spectra of two areas
    ``snel-lafortune``              ``figure-3`` photograph and rendering; ``figure-13``
                                    sensitivities of the bands, where the stack has their
                                    saturation; ``figure-14`` colour of highlights;
                                    ``figure-15`` the highlights of one photograph: original,
                                    clamped to white, reconstructed, and censored
    ==============================  ==============================================================

    Parameters
    ----------
    system
        One of :data:`impasto.systems.SYSTEMS`; ``"impasto"`` has no figures.
    stack
        The photographs as they were taken.
    sbrdf, reflectance
        What the system measured.
    truth
        The truth of a simulation, shown beside the estimates.

    Returns
    -------
    dict
        8-bit sRGB pictures ``(y, x, 3)``.
    """
    if system.name == "tominaga-rgb-camera":
        return _rgb_camera(stack, sbrdf, reflectance, truth)
    if system.name == "tominaga-six-band-adaptation":
        return _six_bands(sbrdf, reflectance, truth)
    if system.name == "snel-lafortune":
        return _lafortune(stack, sbrdf)
    return {}


def _rgb_camera(
    stack: Stack, sbrdf: Any, reflectance: Reflectance | None, truth: Truth | None
) -> dict[str, Picture]:
    found = {"figure-8": normal_panel(sbrdf.normal).picture}
    specular = specular_component(stack, sbrdf)
    bright = specular[np.isfinite(specular)]
    white = float(np.percentile(bright, 99.9)) if bright.size else 1.0
    found["figure-11"] = colour_panel(specular, "", white=max(white, 1e-30)).picture
    if reflectance is not None:
        areas = _areas(sbrdf.shape, 2)
        found["figure-9"] = _marked(diffuse_panel(sbrdf, reflectance).picture, areas)
        found["figure-10"] = _spectra(reflectance, truth, areas, columns=2)
    return found


def _six_bands(
    sbrdf: Any, reflectance: Reflectance | None, truth: Truth | None
) -> dict[str, Picture]:
    needles = [needle_panel(sbrdf.normal, "Surface normals", note="estimated")]
    if truth is not None:
        needles.append(needle_panel(truth.normal, "Surface normals", note="true"))
    found = {
        "figure-2": contact_sheet([gloss_panel(sbrdf)], title="Specular component", width=640),
        "figure-5": contact_sheet(needles, columns=len(needles)),
    }
    if reflectance is not None:
        found["figure-6"] = _spectra(reflectance, truth, _areas(sbrdf.shape, 2)[:2], columns=2)
    return found


def _areas(shape: tuple[int, int], count: int) -> list[Corner]:
    """The middles of ``count`` x ``count`` equal parts of the picture."""
    height, width = shape
    side = max(1, round(AREA * min(shape)))
    return [
        (
            int((row + 0.5) * height / count - side / 2),
            int((column + 0.5) * width / count - side / 2),
            side,
        )
        for row in range(count)
        for column in range(count)
    ]


def _marked(picture: Picture, areas: list[Corner]) -> Picture:
    """The picture, enlarged so that frames and numbers are readable, with its areas."""
    import cv2

    from impasto.pictures.sheet import draw_text

    factor = max(1, round(512 / max(picture.shape[:2])))
    large = np.repeat(np.repeat(picture, factor, axis=0), factor, axis=1)
    for number, (y, x, side) in enumerate(areas, start=1):
        start, end = (x * factor, y * factor), ((x + side) * factor, (y + side) * factor)
        cv2.rectangle(large, start, end, (255, 255, 255), 2, cv2.LINE_AA)
        draw_text(large, f"{number}", (end[0] + 8, end[1]), 22, (255, 255, 255), weight=600)
    return large


def _spectra(
    reflectance: Reflectance, truth: Truth | None, areas: list[Corner], *, columns: int
) -> Picture:
    """The mean spectra of areas, estimated and true."""
    grid = reflectance.wavelengths
    pairs = []
    for y, x, side in areas:
        part = (slice(y, y + side), slice(x, x + side))
        weights = reflectance.coefficients[:, *part].reshape(len(reflectance.basis), -1)
        mean = np.nanmean(weights.astype(np.float64), axis=1) @ reflectance.basis
        true = None
        if truth is not None:
            rows, across = np.mgrid[part]
            true = truth.painting.spectrum(rows.ravel(), across.ravel()).mean(axis=0)
        pairs.append((mean, true))
    both = [line for pair in pairs for line in pair if line is not None]
    # The next fifth above the highest curve.
    high = max(1.0, np.ceil(5.0 * max(float(line.max()) for line in both)) / 5.0)
    panels = []
    for number, (mean, true) in enumerate(pairs, start=1):
        series = [Series("estimated", np.stack([grid, mean], axis=1))]
        if true is not None and truth is not None:
            points = np.stack([truth.painting.wavelengths, true], axis=1)
            inside = (points[:, 0] >= grid[0]) & (points[:, 0] <= grid[-1])
            series.insert(0, Series("true", points[inside], AMBER))
        panels.append(
            diagram_panel(
                series,
                f"Area {number}",
                x=(float(grid[0]), float(grid[-1])),
                y=(0.0, float(high)),
                note="spectral reflectance",
                axis=(f"{grid[0]:.0f}", f"{grid[-1]:.0f} nm"),
                size=(340, 460),
            )
        )
    return contact_sheet(panels, columns=columns)


def _lafortune(stack: Stack, sbrdf: LafortuneSbrdf) -> dict[str, Picture]:
    found = {"figure-3": _reproduction(stack, sbrdf)}
    if stack.saturation is not None:
        sensitivity = _levels(stack).min() / _levels(stack)
        bars = list(zip(NAMES, sensitivity.tolist(), CHANNELS, strict=True))
        panel = bar_panel(bars, "Relative sensitivity of the bands")
        found["figure-13"] = contact_sheet([panel])
    clipped = np.array([(stack.linear(i) == np.inf).any(axis=0).sum() for i in _all(stack)])
    if not clipped.any():
        return found
    worst = int(clipped.argmax())
    rebuilt = reconstruct_highlights(stack)
    found["figure-14"] = _chromaticity(stack, rebuilt)
    found["figure-15"] = _highlights(stack, rebuilt, worst)
    return found


def _all(stack: Stack) -> range:
    return range(len(stack.rig))


def _levels(stack: Stack) -> NDArray[np.float64]:
    """``(band,)``: the linear light from which a band is clipped.

    Where the stack does not say, the largest sample that is not.
    """
    if stack.saturation is not None:
        return np.asarray((stack.saturation - stack.black) * stack.scale)
    levels = np.zeros(stack.shape[1])
    for index in _all(stack):
        linear = stack.linear(index)
        levels = np.maximum(levels, linear.max(axis=(1, 2), where=np.isfinite(linear), initial=0.0))
    return levels


def _reproduction(stack: Stack, sbrdf: LafortuneSbrdf) -> Picture:
    """The photograph that is nearest to a frontal view, without clipped samples, and its model."""
    whole = [i for i in _all(stack) if np.isfinite(stack.linear(i)).all()] or list(_all(stack))
    index = max(whole, key=lambda i: float(stack.rig.views[i, 2]))
    photograph, model = stack.linear(index), sbrdf.predict(stack.rig.take([index]))[0]
    known = photograph[np.isfinite(photograph)]
    white = float(np.percentile(known, 99.5)) if known.size else 1.0
    pair = [("Photograph", photograph), ("Rendering", model)]
    panels = [colour_panel(linear, title, white=max(white, 1e-30)) for title, linear in pair]
    return contact_sheet(panels, columns=2)


def _chromaticity(stack: Stack, rebuilt: Stack) -> Picture:
    """Shares of the bands in the light of one pixel, against its brightness.

    Left as clipped, right as reconstructed: the pixel with the most samples that are clipped in
    some bands and not in all.
    """
    levels = _levels(stack).astype(np.float32)[:, None, None]
    partly = np.zeros(stack.shape[2:])
    for index in _all(stack):
        over = stack.linear(index) == np.inf
        partly += over.any(axis=0) & ~over.all(axis=0)
    partly[np.isnan(just_not_overexposed(stack)).any(axis=0)] = 0.0
    y, x = (int(v) for v in np.unravel_index(partly.argmax(), partly.shape))
    panels = []
    highest = 0.0
    sides = []
    for title, shown in (("Clipped", stack), ("Reconstructed", rebuilt)):
        light = np.stack([shown.linear(i)[:, y, x] for i in _all(stack)])
        light = np.where(light == np.inf, levels[:, 0, 0], light)
        brightness = light.mean(axis=1)
        highest = max(highest, float(np.nanmax(brightness)))
        # Noise hides the colour of dark samples.
        lit = brightness > 0.05 * np.nanmax(brightness)
        sides.append((title, brightness[lit], (light / light.sum(axis=1, keepdims=True))[lit]))
    for title, brightness, share in sides:
        series = [
            Series(name, np.stack([brightness, share[:, band]], axis=1), colour, dots=True)
            for band, (name, colour) in enumerate(zip(NAMES, CHANNELS, strict=True))
        ]
        panels.append(
            diagram_panel(
                series,
                title,
                x=(0.0, highest),
                y=(0.0, 0.8),
                note="share of each band",
                axis=("0", f"brightness {highest:.2g}"),
            )
        )
    return contact_sheet(panels, columns=2)


def _highlights(stack: Stack, rebuilt: Stack, index: int) -> Picture:
    """Figure 15 of one photograph, with the censored alternative."""
    levels = _levels(stack).astype(np.float32)[:, None, None]
    linear = stack.linear(index)
    over = linear == np.inf
    original = np.where(over, levels, linear)
    clamped = np.minimum(original, levels.min())
    whole = rebuilt.linear(index)
    left = np.isinf(whole)
    whole = np.where(left, original, whole)
    censored = np.where(over.any(axis=0), np.float32(np.nan), linear)
    known = whole[np.isfinite(whole)]
    white = max(float(np.percentile(known, 99.9)), 1e-30)
    share = 100.0 * float(over.any(axis=0).mean())
    panels: list[Panel] = [
        colour_panel(original, "Original", note="clipped bands as they are", white=white),
        colour_panel(clamped, "Clamped to white", white=white),
        colour_panel(whole, "Reconstructed", note="snel-lafortune", white=white),
        colour_panel(
            censored, "Censored", note=f"left out: {share:.1f} % of the pixels", white=white
        ),
    ]
    return contact_sheet(panels, columns=2)
