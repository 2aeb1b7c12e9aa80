"""The formats by name: one call for all."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, get_args

from impasto._internal.checks import one_of
from impasto.errors import ArgumentError
from impasto.export.geometry_files import export_height, export_normal_map
from impasto.export.geometry_tiles import export_height_tiles, export_normal_map_tiles
from impasto.export.gltf import export_gltf
from impasto.export.iiif import export_iiif, export_iiif_tiles
from impasto.export.loss import LossReport
from impasto.export.materialx import export_materialx
from impasto.export.mitsuba import export_mitsuba
from impasto.export.openlime import export_openlime
from impasto.export.openlime_tiles import export_openlime_tiles
from impasto.export.rti import export_hsh, export_ptm, export_relight
from impasto.export.source import Source
from impasto.export.stored import LOADED, StoredSource
from impasto.export.usd import export_usd
from impasto.fit.stored import StoredSbrdf

Format = Literal[
    "openlime", "relight", "ptm", "hsh", "gltf", "materialx", "usd", "mitsuba", "height",
    "normal-map", "iiif",
]  # fmt: skip
NOTHING = (
    "result: no pixel has a normal and colours, so there is nothing to export; its status says why"
)
SMALLER = "export a part of it, result[y0:y1, x0:x1], or a smaller scale, result.level(factor)"
RTI = "export openlime or iiif, which are tiled, or a smaller scale, result.level(factor)"


@dataclass(frozen=True)
class Kind:
    """A format.

    Attributes
    ----------
    write
        Of a source and the place to write.
    suffix
        Of its file; empty: a folder.
    tiled
        Of a painting in a store that is too large to be loaded; None: the format holds none so
        large.
    instead
        What to do with such a painting.
    """

    write: Callable[..., LossReport]
    suffix: str = ""
    tiled: Callable[..., LossReport] | None = None
    instead: str = SMALLER


FORMATS: dict[Format, Kind] = {
    "openlime": Kind(export_openlime, tiled=export_openlime_tiles),
    "relight": Kind(export_relight, instead=RTI),
    "ptm": Kind(export_ptm, ".ptm", instead=RTI),
    "hsh": Kind(export_hsh, ".rti", instead=RTI),
    "gltf": Kind(export_gltf, ".glb"),
    "materialx": Kind(export_materialx),
    "usd": Kind(export_usd),
    "mitsuba": Kind(export_mitsuba),
    "height": Kind(export_height, ".exr", export_height_tiles),
    "normal-map": Kind(export_normal_map, ".png", export_normal_map_tiles),
    "iiif": Kind(export_iiif, tiled=export_iiif_tiles),
}


def to(
    format: Format,
    result: Any,
    out: str | Path,
    *,
    reflectance: Any = None,
    pitch_mm: float | None = None,
    name: str | None = None,
    **options: Any,
) -> LossReport:
    """Write a painting in another format, and report what that loses.

    Parameters
    ----------
    format
        ``"openlime"``, ``"relight"``, ``"materialx"``, ``"usd"``, ``"mitsuba"`` and ``"iiif"`` are
        folders; ``"ptm"``, ``"hsh"`` (.rti), ``"gltf"`` (.glb), ``"height"`` (.exr, .tif, .stl or
        .ply) and ``"normal-map"`` (.png) files.
    result
        The result of :func:`impasto.fit_sbrdf`, a :class:`impasto.Surface`, a simulated painting,
        or an opened store (:func:`impasto.open_sbrdf`). One of more than 16 million pixels is
        written tile by tile, in bounded memory: as ``"openlime"``, ``"iiif"``, ``"height"`` and
        ``"normal-map"`` (both .tif); other formats hold none so large.
    out
        The file or the folder. A folder that an export wrote is replaced.
    reflectance
        The result of :func:`impasto.fit_reflectance`: colours are then those under D65, and
        OpenLIME gets the spectra.
    pitch_mm
        Width of a pixel on the painting; default: that of the result. Without one, formats with a
        size have 1 mm per pixel.
    name
        Of the painting; default: that of ``out``.
    **options
        ``displaced=True`` of gltf and usd: a mesh of the relief. ``functions="ptm"`` of relight.
        ``level=True`` of height: about the plane of the panel, as ``height()`` of a result.
        ``scene``, ``url`` and ``quality`` of iiif.

    Returns
    -------
    LossReport
        Colour differences between what the written file shows and :func:`impasto.render`, over the
        same lights and views for all formats; also beside the file, or in the folder, as JSON.

    Raises
    ------
    ArgumentError
        An unknown format, a wrong suffix, a folder with files of other programs, a painting of
        which no pixel was estimated, or one that is too large for the format.
    """
    one_of(format, get_args(Format), "format")
    path = Path(out)
    if isinstance(result, StoredSbrdf):
        if reflectance is not None:
            raise ArgumentError("reflectance: a store has no spectra; load the result instead")
        if result.shape[0] * result.shape[1] > LOADED:
            large = StoredSource(result, pitch_mm, name or path.stem)
            return _tiled(format, large, path, options)
        result = result[:, :]
    source = Source(result, reflectance, pitch_mm, name or path.stem)
    if not source.known.any():
        raise ArgumentError(NOTHING)
    return FORMATS[format].write(source, path, **options)


def _tiled(format: Format, source: StoredSource, path: Path, options: dict[str, Any]) -> LossReport:
    kind = FORMATS[format]
    if kind.tiled is None:
        rows, columns = source.shape
        raise ArgumentError(
            f"result: {source.stored.path} ({columns} x {rows} pixels) is too large for {format}, "
            f"which is written whole; {kind.instead}"
        )
    if not source.known():
        raise ArgumentError(NOTHING)
    return kind.tiled(source, path, **options)
