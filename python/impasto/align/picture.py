"""A picture of an alignment: what was found in each photograph, and what is left at each mark."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from impasto.align.report import Aligned, AlignedPhotograph
from impasto.calibrate.lens_picture import draw_arrows, round_factor
from impasto.calibrate.tones import grey_from
from impasto.frontal_view import FrontalView
from impasto.pictures import Panel, Picture, contact_sheet
from impasto.pictures.sheet import draw_text

Floats = NDArray[np.float64]

_GREEN, _BLUE, _AMBER = (120, 190, 110), (110, 160, 230), (255, 190, 90)
_SIZE = 560
_MOST = 12
"""Photographs that are shown: those with the largest residuals, else evenly spread."""
_LONGEST = 30.0


@dataclass(frozen=True, eq=False)
class Overview:
    """A reduced photograph with the markers that were found.

    Attributes
    ----------
    name
        The photograph.
    picture
        ``(y, x)`` grey.
    size
        Columns and rows of the photograph.
    outlines
        ``(4, 2)`` pixels of each marker.
    """

    name: str
    picture: NDArray[np.uint8]
    size: tuple[int, int]
    outlines: Mapping[str, Floats]


def overview(light: NDArray[np.float32]) -> NDArray[np.uint8]:
    """A reduced grey picture of linear light."""
    import cv2

    scale = min(1.0, _SIZE / max(light.shape))
    size = max(1, round(light.shape[1] * scale)), max(1, round(light.shape[0] * scale))
    return grey_from(np.asarray(cv2.resize(light, size, interpolation=cv2.INTER_AREA)))


def align_picture(seen: Mapping[int, Overview], result: Aligned) -> Picture:
    """``(y, x, 3)``: reduced photographs with markers, the edge of the painting, and residuals.

    ``seen`` are overviews by the numbers of their photographs (:func:`shown_photographs`).
    """
    chosen = sorted(seen)
    left = [result.photographs[number] for number in chosen]
    large = max(
        (float(np.linalg.norm(one.view.residual, axis=1).max()) for one in left), default=0.0
    )
    scale = min(max(seen[number].picture.shape) / max(seen[number].size) for number in chosen)
    factor = round_factor(_LONGEST / max(large * scale, 1e-3))
    known = result.residual_px
    said = "4 marks fit exactly" if known is None else f"residual of marks {known:.3f} pixels"
    shift = result.largest_shift_px
    moved = "" if shift is None else f", shifts up to {shift:.2f} pixels"
    count = len(result.photographs)
    shown = "" if len(chosen) == count else f"; {len(chosen)} of {count} photographs"
    return contact_sheet(
        [_panel(seen[number], result.photographs[number], result, factor) for number in chosen],
        title="Alignment",
        subtitle=f"{said}{moved}; pixel {result.grid.pixel_mm:g} mm; arrows enlarged "
        f"{factor:g} times{shown}",
        width=_SIZE,
    )


def shown_photographs(views: Sequence[FrontalView]) -> set[int]:
    """Numbers of the photographs that the picture shows, of which overviews are kept."""
    count = len(views)
    if count <= _MOST:
        return set(range(count))
    off = [view.rms or 0.0 for view in views]
    worst = np.argsort(off)[::-1][: _MOST // 2]
    spread = np.linspace(0, count - 1, _MOST - len(worst)).astype(int)
    return {*worst.tolist(), *spread.tolist()}


def _panel(one: Overview, aligned: AlignedPhotograph, result: Aligned, factor: float) -> Panel:
    import cv2

    scale = max(one.picture.shape) / max(one.size)
    rgb = np.repeat((0.75 * one.picture).astype(np.uint8)[..., None], 3, axis=2)

    def drawn(points: Floats) -> NDArray[np.int32]:
        return np.asarray(np.rint(16.0 * ((points + 0.5) * scale - 0.5)), np.int32)

    width, height = result.grid.size_mm
    along = np.linspace(-0.5, 0.5, 33)
    ends = np.full_like(along, 0.5)
    edge = np.concatenate([
        np.stack([along * width, ends * height], 1), np.stack([ends * width, -along * height], 1),
        np.stack([-along * width, -ends * height], 1), np.stack([-ends * width, along * height], 1),
    ])  # fmt: skip
    cv2.polylines(rgb, [drawn(aligned.view.pixels(edge))], True, _BLUE, 1, cv2.LINE_AA, 4)
    for name, outline in one.outlines.items():
        cv2.polylines(rgb, [drawn(outline)], True, _GREEN, 2, cv2.LINE_AA, 4)
        x, y = ((outline.max(axis=0) + 0.5) * scale).astype(int).tolist()
        draw_text(rgb, name.split()[-1], (x + 6, y), 17, _AMBER, weight=500)
    places = (aligned.view.found + 0.5) * scale - 0.5
    draw_arrows(rgb, places, aligned.view.residual * scale * factor)
    rms = aligned.view.rms
    return Panel(one.name, rgb, "" if rms is None else f"{rms:.3f} pixels")
