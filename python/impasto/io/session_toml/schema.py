"""The keys of ``session.toml``: one table for reading, writing and the manual."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from impasto.io.session_toml import values
from impasto.io.session_toml.values import Check, Vector

VERSION = 1
"""Of the format; increased when a key changes its meaning."""


@dataclass(frozen=True, kw_only=True)
class Session:
    """The contents of a ``session.toml``; ``docs/session.md`` has the table of its keys.

    Names of files are as written: relative to the folder of the session. None: not given.

    Parameters
    ----------
    path
        The file that was read; None before the first writing.
    allow_outside
        Files may lie outside the session's folder.
    title, size_mm
        Of the painting; width and height in mm.
    camera, focal_length_px
        Name of the camera; focal length in pixels.
    lens, alignment
        Files of a lens and of an alignment, by which photographs are resampled.
    brackets
        Files and exposure times in seconds of each photograph that was taken several times, by the
        name of its shortest exposure.
    noise
        Standard deviations of a code in the dark and at full scale, as shares of full scale.
    images, pattern, bands, layer, encoding, saturation, mask, pitch_mm, region, strict, max_pixels
        As :func:`impasto.read_stack` takes them.
    lights
        A light file.
    directions, positions_mm, views
        In place of a light file: of each photograph the direction to its light, or the position of
        the lamp in mm, and the direction to the eye, as (x, y, z).
    intensities, dark, white, board_reflectance
        As :func:`impasto.read_stack` takes them.
    board_exposure
        Exposure of each photograph over that of its board.
    sha256
        Of each file by its name, 64 hexadecimal digits.
    lines
        Where each key stands in the file, from 1 on.
    """

    path: Path | None = field(default=None, compare=False)
    allow_outside: bool = False
    title: str | None = None
    size_mm: tuple[float, float] | None = None
    camera: str | None = None
    focal_length_px: float | None = None
    lens: str | None = None
    alignment: str | None = None
    images: str | None = None
    pattern: str | tuple[str, ...] | None = None
    bands: tuple[str, ...] | None = None
    layer: str | None = None
    encoding: str | None = None
    saturation: float | tuple[float, ...] | None = None
    mask: str | None = None
    pitch_mm: float | None = None
    region: tuple[int, int, int, int] | None = None
    strict: bool = False
    max_pixels: int | None = None
    noise: tuple[float, float] | None = None
    brackets: Mapping[str, tuple[tuple[str, float], ...]] | None = None
    lights: str | None = None
    directions: Mapping[str, Vector] | None = None
    positions_mm: Mapping[str, Vector] | None = None
    views: Mapping[str, Vector] | None = None
    intensities: Any = None
    dark: Any = None
    white: str | tuple[str, ...] | None = None
    board_reflectance: float | tuple[float, ...] | None = None
    board_exposure: float | tuple[float, ...] | None = None
    sha256: Mapping[str, str] = field(default_factory=dict)
    lines: Mapping[str, int] = field(default_factory=dict, compare=False, repr=False)

    def place(self, key: str) -> str:
        """File, line and key for a message: ``icon/session.toml, line 7: photographs.mask``."""
        line = self.lines.get(key)
        return f"{self.path}{f', line {line}' if line else ''}: {key}"


@dataclass(frozen=True, slots=True)
class Key:
    """One key of the file.

    Parameters
    ----------
    name
        With its section: ``"photographs.mask"``.
    attribute
        Of :class:`Session`.
    check
        Makes the value of the attribute of that of TOML, or raises ``ValueError``.
    meaning
        For people, in the file and in the manual.
    example
        As it is written.
    files
        Whether the value names files.
    """

    name: str
    attribute: str
    check: Check
    meaning: str
    example: str
    files: bool = False


KEYS = (
    Key(
        "allow_outside", "allow_outside", values.truth,
        "Files may lie outside the folder of this file.", "false",
    ),
    Key("painting.title", "title", values.text, "Title of the painting.", '"Saint Nicholas"'),
    Key(
        "painting.size_mm", "size_mm", values.size_mm,
        "Width and height of the painting in mm; must fit into the photographs.", "[300.0, 400.0]",
    ),
    Key("camera.name", "camera", values.text, "Maker and model.", '"NIKON D750"'),
    Key(
        "camera.focal_length_px", "focal_length_px", values.positive,
        "Focal length in pixels; compared with that of the photographs (EXIF).", "9800.0",
    ),
    Key(
        "camera.lens", "lens", values.file,
        "File of impasto calibrate lens: the photographs are read without its distortion.",
        '"lens.json"', files=True,
    ),
    Key(
        "photographs.folder", "images", values.file,
        "Folder of the photographs. Default: that of the light file.", '"photographs"', files=True,
    ),
    Key(
        "photographs.pattern", "pattern", values.pattern,
        "Several files per photograph (a filter wheel), or a list with a pattern for each band.",
        '"{name}_{band}.tif"',
    ),
    Key(
        "photographs.bands", "bands", values.texts,
        "Names of the bands, in the order of the files.", '["red", "green", "blue"]',
    ),
    Key(
        "photographs.alignment", "alignment", values.file,
        "Report of impasto align on these photographs, which are read as it wrote them: on the "
        "pixels of the frontal view.", '"aligned/report/alignment.json"', files=True,
    ),
    Key(
        "photographs.layer", "layer", values.text,
        "The layer of OpenEXR files with several.", '"beauty"',
    ),
    Key(
        "photographs.encoding", "encoding", values.encoding,
        "Tone curve: srgb, linear, a gamma, the file of a measured one, or auto to estimate it. "
        "Default: for 8-bit files that of the colour profile, else srgb; linear for all others, "
        "whatever their profile.",
        '"srgb"',
    ),
    Key(
        "photographs.saturation", "saturation", values.per_band,
        "Code from which a sample is clipped, one or one for each band. Default: the largest.",
        "65520",
    ),
    Key(
        "photographs.mask", "mask", values.file,
        "Picture that is black outside the painting.", '"mask.png"', files=True,
    ),
    Key(
        "photographs.pitch_mm", "pitch_mm", values.length_mm,
        "Width of a pixel on the painting in mm; required for near lamps.", "0.05",
    ),
    Key(
        "photographs.region", "region", values.region,
        "Only this part: top, left, height, width in pixels. Not for jobs.", "[0, 0, 512, 512]",
    ),
    Key(
        "photographs.strict", "strict", values.truth,
        "Refuse photographs that need any repair.", "false",
    ),
    Key(
        "photographs.max_pixels", "max_pixels", values.whole,
        "Larger photographs are refused.", "2147483648",
    ),
    Key(
        "photographs.noise", "noise", values.noise,
        "Of brackets: standard deviation of a code in the dark, and at full scale without that, as "
        "shares of full scale. Default: 0.001 and 0.005.", "[0.001, 0.005]",
    ),
    Key(
        "photographs.brackets", "brackets", values.brackets,
        "Photographs that were taken with several exposures and are read as one: by the file of "
        "the shortest, the files and their exposure times in seconds.",
        '"photo1-1.tif" = [["photo1-1.tif", 0.002], ["photo1-2.tif", 0.008]]',
    ),
    Key(
        "lights.file", "lights", values.file,
        "Light file: .lp, .csv, .txt, .dome, .relight or .json.", '"lights.lp"', files=True,
    ),
    Key(
        "lights.intensities", "intensities", values.strengths,
        "Strength of each light (or one for each of its bands), or a text file of these.",
        "[1.0, 0.97, 1.02]", files=True,
    ),
    Key(
        "lights.directions", "directions", values.vectors,
        "In place of a light file: direction to the light of each photograph (x right, y up, z to "
        "the viewer).", '"photo1.jpg" = [0.5, 0.0, 0.866]',
    ),
    Key(
        "lights.positions_mm", "positions_mm", values.vectors,
        "In place of directions: positions of near lamps in mm from the middle of the painting.",
        '"photo1.jpg" = [500.0, 0.0, 866.0]',
    ),
    Key(
        "lights.views", "views", values.vectors,
        "Beside directions or positions: direction to the eye. Default: in front.",
        '"photo1.jpg" = [0.0, 0.0, 1.0]',
    ),
    Key(
        "calibration.dark", "dark", values.dark,
        "Dark frame, folder or list of dark frames, or the black level in codes.", '"dark"',
        files=True,
    ),
    Key(
        "calibration.white", "white", values.frames,
        "Photograph of a white board, or a folder or list with one for each light.", '"white"',
        files=True,
    ),
    Key(
        "calibration.board_reflectance", "board_reflectance", values.per_band,
        "Reflectance of that board, one or one for each band. Default: 1.", "0.99",
    ),
    Key(
        "calibration.board_exposure", "board_exposure", values.per_light,
        "Exposure time of the photographs over that of their boards, one number or one for each "
        "light. Default: 1.", "[1.0, 0.5, 1.0]",
    ),
    Key(
        "files", "sha256", values.hashes,
        "SHA-256 of each file; another file of that name is refused.",
        f'"photo1.jpg" = "{64 * "0"}"',
    ),
)  # fmt: skip
"""All keys but ``version``, in the order of the file."""

TABLES = frozenset({
    "photographs.brackets", "lights.directions", "lights.positions_mm", "lights.views", "files",
})  # fmt: skip
"""Keys that are sections, with a line for each file."""
