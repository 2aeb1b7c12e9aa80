"""One picture that shows all maps of a result side by side."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impasto.pictures import (
    Panel,
    Picture,
    contact_sheet,
    normal_panel,
    ramp_panel,
    status_panel,
)
from impasto.render import render
from impasto.rig import DistantLight
from impasto.scene import Scene
from impasto.status import Status

PAPER_LIGHT = (0.0, 0.71, 0.71)
"""The light of the papers' pictures: from above, at 45 degrees."""
RAKING_LIGHT = (-0.90, 0.30, 0.31)
"""From the left, 18 degrees above the painting."""


@dataclass(frozen=True, eq=False)
class Visible:
    """A result whose bands a display can show; see :func:`visible`."""

    normal: NDArray[np.float32]
    diffuse: NDArray[np.float32]
    beta: Any
    gamma: Any


def visible(sbrdf: Any, reflectance: Any = None) -> Any:
    """The result as :func:`impasto.render` can show it.

    With a reflectance, or with one or three bands, that is the result itself. Of any other number
    of bands the last, the middle and the first stand in for red, green and blue.
    """
    count = len(sbrdf.diffuse)
    if reflectance is not None or count in {1, 3}:
        return sbrdf
    chosen = np.ascontiguousarray(sbrdf.diffuse[[count - 1, count // 2, 0]])
    return Visible(sbrdf.normal, chosen, sbrdf.beta, sbrdf.gamma)


def overview(
    sbrdf: Any,
    *,
    reflectance: Any = None,
    title: str = "impasto",
    threads: int | None = None,
    extra: tuple[Panel, ...] = (),
) -> Picture:
    """Colour, relief and trust of a fitted painting on one sheet.

    Parameters
    ----------
    sbrdf
        What :func:`impasto.fit_sbrdf` returns.
    reflectance
        What :func:`impasto.fit_reflectance` returns, for colours under D65.
    title
        Heading, as a rule the name of the painting.
    threads
        As everywhere.
    extra
        More pictures, set behind the relit ones.

    Returns
    -------
    ndarray
        8-bit sRGB ``(y, x, 3)``.
    """
    shown = visible(sbrdf, reflectance)
    colours = _colour_note(len(sbrdf.diffuse), reflectance)
    body = Visible(shown.normal, shown.diffuse, 0.0, 0.1)
    flat = Visible(_facing(shown.normal), body.diffuse, 0.0, 0.1)

    def picture(
        of: Any, direction: tuple[float, float, float], exposure: float | None = None
    ) -> Picture:
        lamp = [DistantLight(direction)]
        scene = Scene(lamp, exposure=exposure, background=(0.04, 0.04, 0.04))
        return render(of, scene, reflectance=reflectance, threads=threads).display

    panels = (
        Panel("Diffuse colour", picture(flat, (0.0, 0.0, 1.0)), colours),
        normal_panel(sbrdf.normal),
        Panel("Light from above", picture(shown, PAPER_LIGHT), "45 degrees"),
        Panel("Raking light", picture(shown, RAKING_LIGHT, 2.0), "from the left, 18 degrees"),
        *extra,
        *trust_panels(sbrdf),
    )
    return contact_sheet(panels, title=title, subtitle=subtitle(sbrdf))


def trust_panels(sbrdf: Any) -> tuple[Panel, ...]:
    """How far each pixel can be trusted: predicted angle, residual, samples used, status."""
    stereo = sbrdf.normals
    total = int(stereo.used.max()) + int(stereo.rejected.sum(axis=0).max())
    used = np.where(stereo.status == Status.MASKED, np.nan, stereo.used.astype(np.float32))
    return (
        ramp_panel(
            stereo.sigma, "Predicted error of the normal", unit="degrees", scale=180 / np.pi
        ),
        ramp_panel(sbrdf.residual, "Residual", unit="% of white", scale=100.0),
        ramp_panel(used, "Samples used", unit=f"of up to {total} lights", low=0.0),
        status_panel(sbrdf.status),
    )


def subtitle(sbrdf: Any) -> str:
    """Size, bands and gloss in one line."""
    count, rows, columns = sbrdf.diffuse.shape
    return (
        f"{columns} × {rows} pixels  ·  {count} bands  ·  {len(sbrdf.rig)} lights  ·  "
        f"{gloss_words(sbrdf)}"
    )


def gloss_words(sbrdf: Any) -> str:
    """The gloss in words: ``"gloss: beta 11.7, gamma 7.0 degrees"``."""
    if sbrdf.verdict == "no-highlight":
        return "gloss: no highlight found"
    words = f"gloss: beta {sbrdf.beta:.3g}, gamma {np.degrees(sbrdf.gamma):.3g} degrees"
    return words if sbrdf.verdict == "fitted" else f"{words} (at the bound of its range)"


def _facing(normal: NDArray[np.float32]) -> NDArray[np.float32]:
    """The painting without its relief; unknown pixels stay unknown."""
    flat = np.zeros_like(normal)
    flat[2] = 1.0
    flat[:, np.isnan(normal[2])] = np.nan
    return flat


def _colour_note(count: int, reflectance: Any) -> str:
    if reflectance is not None:
        return "under D65"
    return "as photographed" if count in {1, 3} else "three of the bands, false colours"
