"""One picture with all maps of a result side by side."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from impasto.fit.lafortune import LafortuneSbrdf
from impasto.fit.result import PerPixelSbrdf, median
from impasto.fit.segments import SegmentSbrdf
from impasto.lights import DistantLight
from impasto.pictures import (
    Panel,
    Picture,
    colour_panel,
    contact_sheet,
    curve_panel,
    normal_panel,
    ramp_panel,
    status_panel,
)
from impasto.render import render
from impasto.scene import Scene
from impasto.status import Status
from impasto.surface import Surface

PAPER_LIGHT = (0.0, 0.71, 0.71)
"""The light of the papers' pictures: from above, at 45 degrees."""
RAKING_LIGHT = (-0.90, 0.30, 0.31)
"""From the left, 18 degrees above the painting."""
UNKNOWN = (0.04, 0.04, 0.04)
"""Linear light of pixels that were not estimated."""
VERDICTS = {
    "fitted": "",
    "mixed": ", which does not describe all pixels",
    "at-bound": ", at the bound of its range",
}
"""Remarks that follow beta and gamma."""
DEGREES = 180.0 / np.pi
STEEPEST = 0.7
"""Largest tilt (rad) in the diagram of the gloss: its light is 10 degrees high."""


def visible(sbrdf: Any, reflectance: Any = None) -> Any:
    """The result in bands that :func:`impasto.render` can show.

    With a reflectance, or with one or three bands, that is the result itself. Of any other number
    of bands the last, the middle and the first stand in for red, green and blue.
    """
    if reflectance is not None:
        return sbrdf
    count = len(sbrdf.diffuse)
    if count in {1, 3}:
        return sbrdf
    return sbrdf.with_bands([count - 1, count // 2, 0])


def overview(
    sbrdf: Any,
    *,
    reflectance: Any = None,
    title: str = "impasto",
    threads: int | None = None,
) -> Picture:
    """Colour, relief, gloss and errors of a fitted painting in one picture.

    Parameters
    ----------
    sbrdf
        Result of :func:`impasto.fit_sbrdf`.
    reflectance
        Result of :func:`impasto.fit_reflectance`, for colours under D65.
    title
        Heading, such as the name of the painting.
    threads
        As everywhere.

    Returns
    -------
    ndarray
        8-bit sRGB ``(y, x, 3)``.
    """
    shown = visible(sbrdf, reflectance)

    def lit(direction: tuple[float, float, float], exposure: float | None = None) -> Picture:
        scene = Scene([DistantLight(direction)], exposure=exposure, background=UNKNOWN)
        return render(shown, scene, reflectance=reflectance, threads=threads).display

    panels = (
        diffuse_panel(sbrdf, reflectance, threads=threads),
        normal_panel(sbrdf.normal),
        Panel("Light from above", lit(PAPER_LIGHT), "45 degrees"),
        Panel("Raking light", lit(RAKING_LIGHT, 2.0), "from the left, 18 degrees"),
        gloss_panel(sbrdf),
        *quality_panels(sbrdf),
    )
    return contact_sheet(panels, title=title, subtitle=subtitle(sbrdf), columns=5)


def diffuse_panel(sbrdf: Any, reflectance: Any = None, *, threads: int | None = None) -> Panel:
    """The colours of the paint without relief and gloss, in light from the front."""
    shown = visible(sbrdf, reflectance)
    flat = np.zeros_like(shown.normal)
    flat[2] = 1.0
    flat[:, np.isnan(shown.normal[2])] = np.nan
    matte = Surface(flat, shown.diffuse)
    scene = Scene([DistantLight((0.0, 0.0, 1.0))], background=UNKNOWN)
    picture = render(matte, scene, reflectance=reflectance, threads=threads).display
    return Panel("Diffuse colour", picture, _colour_note(len(sbrdf.diffuse), reflectance))


def quality_panels(sbrdf: Any) -> tuple[Panel, ...]:
    """Quality maps: predicted error, residual, samples, misfit of the gloss, status."""
    if isinstance(sbrdf, PerPixelSbrdf):
        return (
            ramp_panel(sbrdf.sigma, "Predicted error of the normal", unit="degrees", scale=DEGREES),
            ramp_panel(sbrdf.residual, "Residual", unit="% of white", scale=100.0),
            ramp_panel(sbrdf.width[0], "Width of the lobe", unit="degrees", scale=DEGREES),
            ramp_panel(np.where(sbrdf.status < Status.DARK, sbrdf.lobes, np.nan), "Lobes"),
            status_panel(sbrdf.status),
        )
    stereo = sbrdf.normals
    used = np.where(stereo.status == Status.MASKED, np.nan, stereo.used.astype(np.float32))
    return (
        ramp_panel(sbrdf.sigma, "Predicted error of the normal", unit="degrees", scale=DEGREES),
        ramp_panel(sbrdf.residual, "Residual", unit="% of white", scale=100.0),
        ramp_panel(used, "Samples used", unit=f"of {len(sbrdf.rig)} lights"),
        ramp_panel(sbrdf.misfit, "Gloss of its own", unit="share of beta", low=0.0, high=1.0),
        status_panel(sbrdf.status),
    )


def gloss_panel(sbrdf: Any) -> Panel:
    """The measured highlight and the lobe fitted to it, over the tilt of the facets."""
    if isinstance(sbrdf, SegmentSbrdf):
        return ramp_panel(sbrdf.gamma, "Width of the lobe", unit="degrees", scale=DEGREES)
    if isinstance(sbrdf, PerPixelSbrdf):
        # The total reflection of a lobe is proportional to strength times squared width.
        shown = visible(sbrdf)
        energy = np.nansum(shown.specular * shown.width[:, None] ** 2, axis=0)
        energy[:, sbrdf.status > Status.DARK] = np.nan
        known = energy[np.isfinite(energy)]
        white = float(np.percentile(known, 99.0)) if known.size else 1.0
        colours = energy if len(energy) == 3 else np.broadcast_to(energy, (3, *energy.shape[1:]))
        return colour_panel(colours, "Specular colour", white=max(white, 1e-30))
    measured = np.asarray(sbrdf.curve, dtype=np.float64)
    size = sbrdf.status.shape
    if sbrdf.verdict in {"no-highlight", "too-few"} or not np.isfinite(sbrdf.gamma):
        end = float(measured[:, 0].max()) if len(measured) else 1.0
        line = np.array([[0.0, 0.0], [end, 0.0]])
    else:
        end = min(3.0 * float(sbrdf.gamma), STEEPEST)
        phi = np.linspace(0.0, end, 200)
        line = np.stack([phi, _lobe(sbrdf, phi)], axis=1)
    return curve_panel(
        measured[:, :2],
        line,
        "Gloss",
        note="dots: measured, line: fitted" if _searched(sbrdf) else "not fitted",
        axis=("0", f"{np.degrees(end):.0f} degrees of facet tilt"),
        size=(size[0] * 460 // size[1], 460),
    )


def _searched(sbrdf: Any) -> bool:
    """Whether a lobe was looked for: a search leaves its steps, ``pooling="none"`` leaves none."""
    return len(sbrdf.path) > 0


def _lobe(sbrdf: Any, tilt: NDArray[np.float64]) -> NDArray[np.float64]:
    """The fitted lobe without geometry factors, comparable with the measured ``sbrdf.curve``.

    The pixel is flat and seen from the front, under a light at twice the tilt: the facets that
    mirror it have this tilt. The lobe is divided by one of strength 1 and unlimited width.
    """
    lights = np.stack([np.sin(2 * tilt), np.zeros_like(tilt), np.cos(2 * tilt)], axis=1)
    normal = np.array([0.0, 0.0, 1.0]).reshape(3, 1, 1)
    black = np.zeros((1, 1, 1))
    shown, even = (
        Surface.torrance_sparrow(normal, black, *lobe, index=sbrdf.index).predict(lights)
        for lobe in ((sbrdf.beta, sbrdf.gamma), (1.0, 1e4))
    )
    return np.asarray(shown[:, 0, 0, 0] / even[:, 0, 0, 0], dtype=np.float64)


def subtitle(sbrdf: Any) -> str:
    """Size, bands and gloss in one line."""
    count, rows, columns = sbrdf.diffuse.shape
    return (
        f"{columns} × {rows} pixels  ·  {count} band{'s' * (count != 1)}  ·  "
        f"{len(sbrdf.rig)} lights  ·  "
        f"{gloss_words(sbrdf)}"
    )


def gloss_words(sbrdf: Any) -> str:
    """The gloss as text: ``"gloss: beta 11.7, gamma 7.0 degrees"``."""
    varnish = ", under a varnish" * getattr(sbrdf, "coated", False)
    if isinstance(sbrdf, PerPixelSbrdf):
        fine = sbrdf.lobes[sbrdf.status < Status.DARK]
        if not fine.any():
            return "gloss: no highlight found"
        width = median(np.degrees(sbrdf.width))
        kind = "Lafortune lobes" if isinstance(sbrdf, LafortuneSbrdf) else "lobes"
        return f"gloss: {fine.mean():.1f} {kind} per pixel, {width:.3g} degrees wide{varnish}"
    if isinstance(sbrdf, SegmentSbrdf):
        own = sum(one.own for one in sbrdf.segments)
        return f"gloss: {own} of {len(sbrdf.segments)} segments have their own lobe"
    if sbrdf.verdict == "too-few":
        return "gloss: no pixel that could show a highlight"
    if sbrdf.verdict == "no-highlight":
        return "gloss: no highlight found" if _searched(sbrdf) else "gloss: not fitted"
    remark = VERDICTS.get(sbrdf.verdict, f", {sbrdf.verdict}")
    lobe = f"beta {sbrdf.beta:.3g}, gamma {np.degrees(sbrdf.gamma):.3g} degrees"
    return f"gloss: {lobe}{remark}{varnish}"


def _colour_note(count: int, reflectance: Any) -> str:
    if reflectance is not None:
        return "under D65"
    return "as photographed" if count in {1, 3} else "three of the bands, false colours"
