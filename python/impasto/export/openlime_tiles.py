"""OpenLIME's BRDF layer of a painting of any size: a Deep Zoom pyramid for each of its channels.

Each scale is made of the maps that the store has at that scale, whose lobes the scatter of the
normals has widened; pyramids of averaged pictures would show gloss too sharp from afar.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impasto._internal.windows import Window
from impasto.export.deepzoom import TILE, levels_of, tile_path, write_pyramids
from impasto.export.folder import export_folder
from impasto.export.loss import REPORT, LossReport, Shown, measure_parts, written
from impasto.export.openlime import (
    CHANNELS,
    INDEX,
    LOST,
    brdf_options,
    brightness_of,
    codes_of,
    shown_of,
)
from impasto.export.source import Source
from impasto.export.stored import StoredSource
from impasto.export.textures import textures
from impasto.io.images.read import read_image
from impasto.io.images.write import write_json


def export_openlime_tiles(source: StoredSource, out: Path) -> LossReport:
    """Write the folder, as :func:`~impasto.export.openlime.export_openlime` does, tile by tile.

    The layout of the layer is ``deepzoom1px``. The loss is measured in nine tiles of the largest
    scale.
    """
    source.check_scales()
    brightness = brightness_of(textures(source.overview(), "ward").diffuse)
    options = brdf_options("deepzoom1px", ".dzi")
    content: dict[str, Any] = {"layers": {"brdf": options}, "brightness": brightness}

    def tiles(factor: int, window: Window) -> dict[str, NDArray[np.uint8]]:
        return codes_of(textures(source.scaled(factor, window), "ward"), brightness)

    with export_folder(out) as folder:
        write_pyramids(folder, CHANNELS, source.shape, tiles)
        write_json(folder / INDEX, content)
        files = [path for path in folder.rglob("*") if path.is_file()]
        colours = measure_parts(_parts(source, folder, options, brightness), oblique=False)
        kept = (
            "normals, diffuse colour and one lobe per pixel (Ward), 8 bits each, at all scales",
        )
        lost = (*LOST, "spectra and the RTI layer: export a smaller scale for these")
        report = LossReport("OpenLIME", kept, lost, files=written(files, folder), **colours)
        write_json(folder / INDEX, {**content, "impasto": _short(report)})
        report.save(folder / REPORT)
    return report


def _parts(
    source: StoredSource, folder: Path, options: dict[str, Any], brightness: float
) -> list[tuple[Source, Shown]]:
    """Some tiles of the painting, and what is shown of them."""
    level = levels_of(source.shape)[0][0]
    found = []
    for row, column, window in source.sampled(TILE):
        part = source.part(window)
        if part.known.any():
            maps = {name: read_image(tile_path(folder, name, level, row, column))
                    for name in CHANNELS}  # fmt: skip
            found.append((part, shown_of(maps, options, brightness)))
    return found


def _short(report: LossReport) -> dict[str, Any]:
    """Without the names of thousands of files, which a viewer need not load."""
    return {name: value for name, value in report.to_dict().items() if name != "files"}
