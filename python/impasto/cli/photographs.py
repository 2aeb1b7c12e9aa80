"""How photographs are read: the options that `fit` and `doctor` share."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Group, Parameter

from impasto._internal.checks import length_mm
from impasto.cli.options import Flag
from impasto.errors import ArgumentError

if TYPE_CHECKING:
    from impasto.simulate import Capture
    from impasto.stack import Stack

GROUP = Group("Photographs", sort_key=1)
TO_16_BITS = 4
"""Shift of the simulated sensor's 12 bits to the top of 16."""


@Parameter(name="*", group=GROUP)
@dataclass(frozen=True, kw_only=True)
class Reading:
    """Options of :func:`impasto.read_stack` on the command line."""

    encoding: Annotated[str | None, Parameter(metavar="CURVE")] = None
    """Tone curve of the files: srgb, linear, a gamma such as 2.2, the file of impasto calibrate
    linearity, or auto to estimate it from the photographs. Default: srgb for 8-bit files, linear
    for all others."""

    lights: Path | None = None
    """File of light directions if STACK is a folder or a session; default: the only one in the
    folder, or that of the session."""

    images: Path | None = None
    """Folder of the photographs; default: that of the light file."""

    mask: Path | None = None
    """Picture that is black outside the painting."""

    saturation: Annotated[
        tuple[float, ...] | None, Parameter(metavar="CODE", consume_multiple=True, negative="")
    ] = None
    """Code from which samples are clipped, one or one per band; default: the largest code."""

    white: Path | None = None
    """Photograph of a white board, or a folder with one per light."""

    dark: Annotated[str | None, Parameter(metavar="PATH|CODE")] = None
    """Dark frame, a folder of dark frames, or the black level in codes."""

    intensities: Path | None = None
    """Text file with the strength of each light."""

    pattern: str | None = None
    """Several files per observation: "{name}_{band}.tif"."""

    bands: Annotated[
        tuple[str, ...] | None, Parameter(metavar="NAME", consume_multiple=True, negative="")
    ] = None
    """Names of the bands, in the order of the files."""

    pitch: float | None = None
    """Width of a pixel on the painting in mm; required for near lamps."""

    region: Annotated[
        tuple[int, int, int, int] | None, Parameter(metavar="TOP LEFT HEIGHT WIDTH", negative="")
    ] = None
    """Read only this part, in pixels."""

    strict: Flag = False
    """Refuse a stack that needs any repair."""

    def check(self) -> None:
        """Refuse values that no photographs could make valid."""
        if self.pitch is not None:
            length_mm(self.pitch, "pitch_mm")
        if self.region is not None:
            top, left, height, width = self.region
            if min(top, left) < 0 or min(height, width) < 1:
                raise ArgumentError(
                    "--region: expected TOP and LEFT from 0 on, HEIGHT and WIDTH from 1 on, found "
                    + " ".join(map(str, self.region))
                )
        for code in self.saturation or ():
            if math.isnan(code):
                raise ArgumentError("--saturation: expected numbers, found NaN")
        dark_of(self.dark)

    def read(self, path: Path) -> Stack:
        """The stack at ``path``."""
        from impasto.io import read_stack

        return read_stack(path, region=self.region, **self.options())

    def options(self) -> dict[str, Any]:
        """Arguments of :func:`impasto.read_stack` but the region."""
        arguments: dict[str, Any] = asdict(self)
        del arguments["region"]
        arguments["pitch_mm"] = arguments.pop("pitch")
        arguments["dark"] = dark_of(self.dark)
        return arguments

    def paths(self, stack: Path) -> list[Path]:
        """The inputs: ``stack`` and the files and folders that these options name."""
        dark = None if self.dark is None or _is_number(self.dark) else Path(self.dark)
        named = (stack, self.lights, self.images, self.mask, self.white, self.intensities, dark)
        return [path for path in named if path is not None]


@Parameter(name="*", group=GROUP)
@dataclass(frozen=True, kw_only=True)
class WholeReading(Reading):
    """The same of commands that take whole photographs, and say so where a part is asked for."""

    region: Annotated[tuple[int, int, int, int] | None, Parameter(show=False, negative="")] = None


def dark_of(text: str | None) -> str | float | None:
    """A black level, or the name of a dark frame or a folder of them."""
    if text is None:
        return None
    if _is_number(text):
        return float(text)
    if not Path(text).exists():
        raise ArgumentError(f"--dark: {text} is neither a number nor a file")
    return text


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def write_photographs(folder: Path, capture: Capture) -> Stack:
    """Write a simulated session as files, and read them with :func:`impasto.read_stack`.

    ``lights.lp``, or ``lights.csv`` where photographs have different views,
    ``light_intensities.txt``, one 16-bit TIFF per photograph and ``camera.csv``. The 12 bits of
    the sensor are the upper ones of 16, as from raw converters.
    """
    from impasto.io import read_stack, write_camera, write_lights, write_tiff16

    stack, camera = capture.stack, capture.truth.camera
    folder.mkdir()
    rig = stack.rig
    digits = max(2, len(str(len(rig))))
    names = [f"light{i + 1:0{digits}d}.tif" for i in range(len(rig))]
    for name, codes in zip(names, stack.samples, strict=True):
        write_tiff16(folder / name, codes << TO_16_BITS, attributes={"bands": stack.bands})
    lights = folder / ("lights.csv" if (rig.views != rig.views[0]).any() else "lights.lp")
    write_lights(lights, rig, names)
    write_camera(folder / "camera.csv", camera)
    # One column for all bands, or one for each.
    scale = stack.scale[:1] if (stack.scale == stack.scale[0]).all() else stack.scale
    strength = rig.intensities[:, None] / (65535.0 * scale / (1 << TO_16_BITS))
    text = "".join(" ".join(map(repr, row)) + "\n" for row in strength.tolist())
    (folder / "light_intensities.txt").write_text(text, encoding="utf-8")
    assert stack.saturation is not None  # the simulated sensor has 12 bits
    return read_stack(
        lights,
        encoding="linear",
        dark=float(stack.black[0]) * (1 << TO_16_BITS),
        saturation=float(stack.saturation[0]) * (1 << TO_16_BITS),
        bands=stack.bands,
        pitch_mm=stack.rig.pitch_mm,
    )
