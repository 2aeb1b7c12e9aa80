"""The formats by name: one call for all."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, get_args

from impasto._internal.checks import one_of
from impasto.errors import ArgumentError
from impasto.export.geometry_files import export_height, export_normal_map
from impasto.export.gltf import export_gltf
from impasto.export.iiif import export_iiif
from impasto.export.loss import LossReport
from impasto.export.materialx import export_materialx
from impasto.export.mitsuba import export_mitsuba
from impasto.export.openlime import export_openlime
from impasto.export.rti import export_hsh, export_ptm, export_relight
from impasto.export.source import Source
from impasto.export.usd import export_usd

Format = Literal[
    "openlime", "relight", "ptm", "hsh", "gltf", "materialx", "usd", "mitsuba", "height",
    "normal-map", "iiif",
]  # fmt: skip


@dataclass(frozen=True)
class Kind:
    """A format.

    Attributes
    ----------
    write
        Of a source and the place to write.
    suffix
        Of its file; empty: a folder.
    """

    write: Callable[..., LossReport]
    suffix: str = ""


FORMATS: dict[Format, Kind] = {
    "openlime": Kind(export_openlime),
    "relight": Kind(export_relight),
    "ptm": Kind(export_ptm, ".ptm"),
    "hsh": Kind(export_hsh, ".rti"),
    "gltf": Kind(export_gltf, ".glb"),
    "materialx": Kind(export_materialx),
    "usd": Kind(export_usd),
    "mitsuba": Kind(export_mitsuba),
    "height": Kind(export_height, ".exr"),
    "normal-map": Kind(export_normal_map, ".png"),
    "iiif": Kind(export_iiif),
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
        The result of :func:`impasto.fit_sbrdf`, a :class:`impasto.Surface`, or a simulated
        painting.
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
        which no pixel was estimated.
    """
    one_of(format, get_args(Format), "format")
    path = Path(out)
    source = Source(result, reflectance, pitch_mm, name or path.stem)
    if not source.known.any():
        raise ArgumentError(
            "result: no pixel has a normal and colours, so there is nothing to export; its status "
            "says why"
        )
    return FORMATS[format].write(source, path, **options)
