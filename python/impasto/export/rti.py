"""RTI files of a painting: what it shows under lights of a dome, in the functions of the format.

Least squares over :data:`LIGHTS` lights, in display codes as the programs show them
[@malzbender2001polynomial; @gautron2004hemispherical].
"""

from __future__ import annotations

from pathlib import Path
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from impasto._internal.checks import one_of
from impasto.encoding import Encoding
from impasto.export.folder import export_file, export_folder
from impasto.export.loss import REPORT, LossReport, Shown, measure, written
from impasto.export.source import Direction, Map, Source
from impasto.io.rti import (
    Basis,
    RelightableImage,
    quantised,
    read_relightable,
    write_ptm,
    write_relight,
    write_rti,
)
from impasto.io.rti.image import dome

LIGHTS = 64
"""Lights of the dome: seven times the functions of nine, so that least squares averages."""
Functions = Literal["ptm", "hsh"]
TERMS = {"ptm": 6, "hsh": 9}
_WORDS = {"ptm": "a polynomial of second order in the light", "hsh": "nine hemispherical harmonics"}
LOST = (
    "every view but the front",
    "spectra, illuminants and adaptation: colours are those under D65",
    "sharp highlights and shadows: the functions are smooth",
    "normals and the reflection model",
)


def projected(source: Source, kind: Functions) -> NDArray[np.float32]:
    """``(function, 3, y, x)`` coefficients of display codes, by least squares over a dome."""
    lights = dome(LIGHTS)
    basis = Basis(kind, TERMS[kind])
    inverse = np.linalg.pinv(basis.values(lights)).astype(np.float32)
    encoding = Encoding("srgb")
    found = np.zeros((basis.terms, 3, *source.shape), np.float32)
    for light, weights in zip(lights, inverse.T, strict=True):
        x, y, z = light.tolist()
        shown = np.clip(source.linear((x, y, z)), 0.0, 1.0)
        codes = np.asarray(encoding.encode(shown), dtype=np.float32)
        for term, weight in enumerate(weights):
            found[term] += weight * codes
    return found


def relightable(source: Source, kind: Functions, *, file: bool) -> RelightableImage:
    """The painting as planes of 8 bits.

    ``file``: as ``.ptm`` and ``.rti`` hold them, one scale per function; otherwise one per plane.
    """
    return quantised(
        projected(source, kind),
        Basis(kind, TERMS[kind]),
        shared=file,
        whole=file and kind == "ptm",
        lights=None if file else dome(LIGHTS),
        pitch_mm=None if file else source.pitch_mm,
    )


def export_ptm(source: Source, out: Path) -> LossReport:
    """Write a ``.ptm``: a polynomial texture map in RGB that every RTI viewer reads."""
    with export_file(out, ".ptm") as (path, beside):
        write_ptm(path, relightable(source, "ptm", file=True))
        report = _report(source, path, "PTM", "ptm", [path])
        report.save(beside)
    return report


def export_hsh(source: Source, out: Path) -> LossReport:
    """Write an ``.rti`` of hemispherical harmonics."""
    with export_file(out, ".rti") as (path, beside):
        write_rti(path, relightable(source, "hsh", file=True))
        report = _report(source, path, "HSH", "hsh", [path])
        report.save(beside)
    return report


def export_relight(source: Source, out: Path, *, functions: Functions = "hsh") -> LossReport:
    """Write a folder that relight's tools and OpenLIME's RTI layer read.

    ``functions``: ``"hsh"``, nine hemispherical harmonics, or ``"ptm"``, a polynomial.
    """
    one_of(functions, get_args(Functions), "functions")
    image = relightable(source, functions, file=False)
    with export_folder(out) as folder:
        write_relight(folder, image)
        report = _report(source, folder, "relight", functions, list(folder.iterdir()))
        write_relight(folder, image, extra={"impasto": report.to_dict()})
        report.save(folder / REPORT)
    return report


def _report(
    source: Source, path: Path, name: str, kind: Functions, files: list[Path]
) -> LossReport:
    image = read_relightable(path)
    kept = (
        f"{_WORDS[kind]}, {len(image.planes)} planes of 8 bits",
        "display codes (sRGB): what programs show as they are",
    )
    return LossReport(
        name,
        kept,
        LOST,
        files=written(files, path if path.is_dir() else path.parent),
        **measure(source, shown_by(image), oblique=False),
    )


def shown_by(image: RelightableImage) -> Shown:
    """What a file of RTI shows: the whole picture for a light, of which pixels are taken."""

    def shown(light: Direction, view: Direction | None, at: NDArray[np.intp]) -> Map:
        return image.pixels(at).linear(light)[0, :, :, 0]

    return shown
