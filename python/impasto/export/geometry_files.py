"""Heights and normals as files: OpenEXR, 16-bit TIFF, STL, PLY, and a normal map for Blender."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from impasto.errors import ArgumentError
from impasto.export.folder import export_file
from impasto.export.loss import LossReport, written
from impasto.export.mesh import Grid, height_of, relief
from impasto.export.source import Map, Source
from impasto.export.textures import (
    coded_normals,
    coded_srgb,
    colours,
    decoded_normals,
    normals,
)
from impasto.io.files import atomic_bytes
from impasto.io.images.read import read_image
from impasto.io.images.write import write_exr, write_png16, write_tiff16
from impasto.level import Level

SUFFIXES = (".exr", ".tif", ".tiff", ".stl", ".ply")
_RECORD = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
_LOST = ("gloss and everything else but the height",)
_SURFACE = ("a back: the mesh is a surface, to be closed for printing",)


def export_height(source: Source, out: Path, *, level: bool | Level = False) -> LossReport:
    """Write the height; the suffix selects the format.

    ``.exr`` holds mm as 32-bit floats (channel ``Z``, NaN where unknown), ``.tif`` 16-bit codes
    with ``mm_per_code`` and ``mm_at_code_0`` in its description, ``.stl`` (binary) and ``.ply``
    (binary, with vertex colours) a mesh in mm, its origin in the middle of the painting, x right, y
    up, z towards the viewer. Heights are about their mean, with the lean of the panel, or with
    ``level`` about its plane.

    Raises
    ------
    ArgumentError
        Another suffix, or a mesh of more points than programs hold.
    """
    height, plane = height_of(source, level)
    with export_file(out, *SUFFIXES) as (path, beside):
        suffix = path.suffix.lower()
        if suffix == ".exr":
            measured = _exr(source, height, path)
            kept = ("heights in mm as 32-bit floats",)
        elif suffix in {".tif", ".tiff"}:
            measured = _tiff(source, height, path)
            kept = ("heights in mm as 16-bit codes, with their scale",)
        elif suffix == ".stl":
            measured = _stl(relief(source, height=height), height, path)
            kept = ("a mesh in mm, one point per pixel",)
        else:
            measured = _ply(source, relief(source, height=height), height, path)
            kept = ("a mesh in mm, one point per pixel, with the diffuse colour in sRGB",)
        lost = _LOST + (_SURFACE if suffix in {".stl", ".ply"} else ())
        if not source.pitch_mm:
            lost += ("the size: 1 mm stands in for the width of a pixel",)
        lost += lost_lean(plane)
        files = written([path], path.parent)
        report = LossReport(f"height {suffix}", kept, lost, files=files, measured=measured)
        report.save(beside)
    return report


def export_normal_map(source: Source, out: Path) -> LossReport:
    """Write a 16-bit PNG for Blender and others: ``(n + 1) / 2`` in R, G, B.

    Tangent space of a panel that faces the viewer: red is right, green is **up** (the OpenGL
    convention, which Blender, glTF, USD and MaterialX use; DirectX and Unreal have green down),
    blue towards the viewer. Unknown pixels face the viewer. Programs must read it as data
    ("Non-Color" in Blender).
    """
    normal = normals(source)
    with export_file(out, ".png") as (path, beside):
        write_png16(path, coded_normals(normal, 16))
        angle = np.degrees(angles_between(decoded_normals(read_image(path)), normal))
        report = normal_map_report(path, angle)
        report.save(beside)
    return report


def lost_lean(plane: Level | None) -> tuple[str, ...]:
    """That heights are about a plane, if they are."""
    if plane is None:
        return ()
    return (f"the lean ({plane}): heights are about its plane",)


def normal_map_report(path: Path, angle: Map) -> LossReport:
    """What a normal map keeps; ``angle``: of its normals to the painting's, in degrees."""
    return LossReport(
        "normal map",
        ("normals of 16 bits, x right, y up, z towards the viewer",),
        ("colours, gloss and everything else but the normals",),
        files=written([path], path.parent),
        measured={
            "degrees_median": float(np.median(angle)),
            "degrees_most": float(angle.max()),
        },
    )


def angles_between(found: Map, normal: Map) -> Map:
    """Between unit vectors, from their distance: exact also for small angles."""
    distance = np.linalg.norm(found.astype(np.float64) - normal.astype(np.float64), axis=0)
    return np.asarray(2.0 * np.arcsin(np.clip(0.5 * distance, 0.0, 1.0)), dtype=np.float64)


def _exr(source: Source, height: Map, path: Path) -> dict[str, float]:
    known = np.where(source.known, height, np.float32(np.nan))
    attributes: dict[str, str | float | int] = {
        "unit": "mm",
        "pixelSizeInMM": float(source.pitch_mm or 1.0),
    }
    write_exr(path, {"Z": known}, attributes=attributes)
    return _error(read_image(path)[0], known)


def _tiff(source: Source, height: Map, path: Path) -> dict[str, float]:
    low, high = float(height.min()), float(height.max())
    step = max(high - low, 1e-9) / 65535.0
    codes = np.rint((height.astype(np.float64) - low) / step).astype(np.uint16)
    facts = {
        "mm_per_code": step,
        "mm_at_code_0": low,
        "pixelSizeInMM": float(source.pitch_mm or 1.0),
    }
    write_tiff16(path, codes, attributes=facts)
    return _error(read_image(path)[0].astype(np.float64) * step + low, height)


def _stl(grid: Grid, height: Map, path: Path) -> dict[str, float]:
    """80 bytes of text, the number of triangles, and 50 bytes for each."""
    corners = grid.points[grid.triangles]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-30)
    records = np.zeros(len(corners), _RECORD)
    records["normal"], records["corners"] = normal, corners
    head = b"impasto: height in mm, x right, y up, z towards the viewer".ljust(80)
    atomic_bytes(path, head + len(records).to_bytes(4, "little") + records.tobytes())
    found = np.frombuffer(path.read_bytes(), _RECORD, offset=84)["corners"]
    first = found.reshape(-1, 2, 3, 3)[:, 0, 0, 2].reshape(height.shape[0] - 1, -1)
    return _error(first, height[:-1, :-1])


def _ply(source: Source, grid: Grid, height: Map, path: Path) -> dict[str, float]:
    colour = coded_srgb(colours(source)).reshape(3, -1).T
    vertex = np.dtype([("place", "<f4", 3), ("colour", "u1", 3)])
    vertices = np.zeros(len(grid.points), vertex)
    vertices["place"], vertices["colour"] = grid.points, colour
    face = np.dtype([("count", "u1"), ("corners", "<i4", 3)])
    faces = np.zeros(len(grid.triangles), face)
    faces["count"], faces["corners"] = 3, grid.triangles
    lines = [
        "ply",
        "format binary_little_endian 1.0",
        "comment impasto: height in mm, x right, y up, z towards the viewer",
        f"element vertex {len(vertices)}",
        *(f"property float {axis}" for axis in "xyz"),
        *(f"property uchar {name}" for name in ("red", "green", "blue")),
        f"element face {len(faces)}",
        "property list uchar int vertex_indices",
        "end_header",
    ]
    head = ("\n".join(lines) + "\n").encode("ascii")
    atomic_bytes(path, head + vertices.tobytes() + faces.tobytes())
    found = np.frombuffer(path.read_bytes(), vertex, len(vertices), len(head))["place"][:, 2]
    return _error(found.reshape(height.shape), height)


def _error(found: object, height: Map) -> dict[str, float]:
    difference = np.abs(np.asarray(found, dtype=np.float64) - height)
    spread = height[np.isfinite(height)]
    if not spread.size:
        raise ArgumentError("result: no pixel has a height")
    return {
        "height_range_mm": float(spread.max() - spread.min()),
        "height_error_mm": float(np.nanmax(difference)),
    }
