"""Heights and normals of a painting of any size: tiled TIFF, in the memory of some rows."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from io import FileIO
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impasto._internal.windows import Window
from impasto.errors import ArgumentError
from impasto.export.folder import export_file
from impasto.export.geometry_files import angles_between, lost_lean, normal_map_report
from impasto.export.loss import LossReport, written
from impasto.export.source import Map
from impasto.export.stored import LOADED, StoredSource
from impasto.export.textures import FLAT, coded_normals, decoded_normals
from impasto.fit.stored.height import height_rows
from impasto.io.files import as_problem_of
from impasto.io.images.bands_of_rows import TIFF_TILE, write_tiff_rows
from impasto.level import Level, as_level

SUFFIXES = (".tif", ".tiff")
_LOST_HEIGHT = "gloss and everything else but the height"


def export_height_tiles(
    source: StoredSource, out: Path, *, level: bool | Level = False
) -> LossReport:
    """Write the height as 16-bit codes in a tiled TIFF, with their scale in its description.

    It is integrated tile by tile (:meth:`impasto.StoredSbrdf.height`). Codes need the lowest and
    the highest place, so that heights wait as 32-bit floats in a file of their own meanwhile: 4
    bytes per pixel beside ``out``. With ``level`` they are about the plane of the panel.

    Raises
    ------
    ArgumentError
        Another suffix than ``.tif``, or a plane that bends.
    """
    _check_suffix(source, out, ".tif, whose heights are integrated tile by tile")
    plane = _plane(source, level)
    rows, columns = source.shape
    with export_file(out, *SUFFIXES) as (path, beside):
        # Not a memory map: a full disk is then an error that can be told, not a signal.
        raw = path.with_name("heights")
        low, high = np.inf, -np.inf
        with raw.open("wb", buffering=0) as file:
            for band in height_rows(_normals(source, plane), source.shape, source.pitch_mm or 1.0):
                with as_problem_of(path):
                    _write_all(file, band[0].astype(np.float32).tobytes())
                low, high = min(low, float(band.min())), max(high, float(band.max()))
        step = max(high - low, 1e-9) / 65535.0
        facts = {
            "mm_per_code": step,
            "mm_at_code_0": low,
            "pixelSizeInMM": float(source.pitch_mm or 1.0),
        }
        worst = 0.0

        def coded() -> Iterator[NDArray[np.uint16]]:
            nonlocal worst
            with raw.open("rb") as file:
                for first in range(0, rows, TIFF_TILE):
                    count = min(TIFF_TILE, rows - first)
                    band = np.fromfile(file, np.float32, count * columns).astype(np.float64)
                    codes = np.rint((band - low) / step)
                    worst = max(worst, float(np.abs(codes * step + low - band).max()))
                    yield codes.astype(np.uint16).reshape(1, count, columns)

        write_tiff_rows(path, coded(), source.shape, planes=1, dtype=np.uint16, attributes=facts)
        raw.unlink()
        lost: tuple[str, ...] = (_LOST_HEIGHT,)
        if not source.pitch_mm:
            lost += ("the size: 1 mm stands in for the width of a pixel",)
        lost += lost_lean(plane)
        report = LossReport(
            "height .tif",
            ("heights in mm as 16-bit codes, with their scale",),
            lost,
            files=written([path], path.parent),
            measured={"height_range_mm": high - low, "height_error_mm": worst},
        )
        report.save(beside)
    return report


def export_normal_map_tiles(source: StoredSource, out: Path) -> LossReport:
    """Write a 16-bit normal map as a tiled TIFF, with the codes of the ``.png``.

    Raises
    ------
    ArgumentError
        Another suffix than ``.tif``.
    """
    _check_suffix(source, out, ".tif, which is written tile by tile")
    rows, columns = source.shape
    angles: list[Map] = []

    def coded() -> Iterator[NDArray[np.uint16]]:
        for top in range(0, rows, TIFF_TILE):
            window = slice(top, min(top + TIFF_TILE, rows)), slice(0, columns)
            normal = normals_of(source, window)
            codes = coded_normals(normal, 16)
            angles.append(angles_between(decoded_normals(codes[:, ::16]), normal[:, ::16]).ravel())
            yield codes

    with export_file(out, *SUFFIXES) as (path, beside):
        write_tiff_rows(path, coded(), source.shape, planes=3, dtype=np.uint16)
        report = normal_map_report(path, np.degrees(np.concatenate(angles)))
        report.save(beside)
    return report


def _write_all(file: FileIO, data: bytes) -> None:
    """Write bytes without a buffer, whose rest would be written when the file is closed."""
    left = memoryview(data)
    while left:
        left = left[file.write(left) :]


def normals_of(source: StoredSource, window: Window) -> Map:
    """``(3, y, x)`` unit vectors of a window, straight ahead where unknown; no more is read."""
    found = np.array(source.stored.map("normal", *window), dtype=np.float32)
    unknown = ~np.isfinite(found[2])
    found[:, unknown] = np.array(FLAT, np.float32)[:, None]
    return found


def _plane(source: StoredSource, level: bool | Level) -> Level | None:
    plane = source.stored.find_level() if level is True else as_level(level, ())
    if plane is not None and any(plane.bend):
        raise ArgumentError("level: the bending of a plane is not taken out tile by tile")
    return plane


def _normals(source: StoredSource, plane: Level | None) -> Callable[[slice, slice], Map]:
    def read(rows: slice, columns: slice) -> Map:
        found: NDArray[Any] = source.stored.map("normal", rows, columns)
        normal = np.asarray(found, dtype=np.float32)
        return normal if plane is None else plane.rotated(normal)

    return read


def _check_suffix(source: StoredSource, out: Path, words: str) -> None:
    if out.suffix.lower() not in SUFFIXES:
        rows, columns = source.shape
        raise ArgumentError(
            f"out: a painting of {columns} x {rows} pixels, more than {LOADED}, is written as "
            f"{words}; found {out.name}. Name it so, or export a part or a smaller scale"
        )
