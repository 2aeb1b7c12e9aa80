"""`read_stack`: from files on a disk to one linear stack."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from numpy.typing import ArrayLike

from impasto.encoding import Encoding
from impasto.errors import ArgumentError
from impasto.io.images import MAX_PIXELS
from impasto.io.lights import LightFile
from impasto.io.session.frames import FrameSource
from impasto.io.session.from_session import SessionPhotographs
from impasto.io.session.photographs import read_photographs
from impasto.io.session_toml import is_session
from impasto.rig import Rig
from impasto.stack import Stack


def read_stack(
    path: str | Path,
    *,
    lights: str | Path | LightFile | Rig | ArrayLike | None = None,
    images: str | Path | None = None,
    encoding: Encoding | str | None = None,
    mask: str | Path | ArrayLike | None = None,
    saturation: ArrayLike | None = None,
    white: FrameSource | None = None,
    dark: FrameSource | None = None,
    board_reflectance: ArrayLike | None = None,
    intensities: str | Path | ArrayLike | None = None,
    pattern: str | Sequence[str] | None = None,
    bands: Sequence[str] | None = None,
    pitch_mm: float | None = None,
    region: Sequence[int] | None = None,
    layer: str | None = None,
    strict: bool = False,
    max_pixels: int = MAX_PIXELS,
) -> Stack:
    """Read the photographs of one painting and their lights.

    Everything repaired, dropped or assumed on the way is listed in ``stack.notes`` and logged to
    ``impasto.io``.

    Parameters
    ----------
    path
        A light file (``.lp``, ``.relight``, ``.dome``, text, CSV, JSON) beside its photographs,
        a folder of photographs, a ``session.toml`` or a folder with one, an ``.npz`` written by
        :func:`impasto.io.write_stack`, or a ``.zarr`` made by :func:`impasto.ingest`. An argument
        that is given beside a session is used in place of the session's; the notes say so.
    lights
        The lights, where ``path`` is a folder: a light file, ``(obs, 3)`` directions or a
        :class:`~impasto.Rig`; default: the folder's only light file.
    images
        The folder of the photographs; default: that of ``path``.
    encoding
        How linear light became the files' codes: ``"linear"``, ``"srgb"``, a gamma such as
        ``"2.2"``, the file of :func:`impasto.io.write_tone_curve` (``"tone.json"``), or ``"auto"``
        to estimate it from the photographs themselves (see
        :func:`impasto.io.estimate_tone`). None (default): 8-bit files have the curve of their
        colour profile (ICC), else sRGB, unless twelve or more coloured photographs show beyond
        doubt that they are not; all other files are linear. What was assumed is in the notes.
    mask
        A picture or ``(y, x)`` array: the painting is where it is not 0.
    saturation
        The code from which a sample counts as clipped, one or one per band; default: the largest
        code of an integer file.
    white
        Photographs of a white board in the painting's plane: one per light (folder, list or
        ``(obs, band, y, x)`` codes), or one for all. Applied by eq. 3 of the RGB-camera paper,
        I' = (I - dark) cos(theta_w) / (W - dark): vignetting, fall-off and the strength of the
        lights cancel. Where the board itself is clipped or dark, samples become NaN.
    dark
        Dark or ambient frames (averaged), or a black level in codes, one number or one per band.
        A level alone leaves linear integers as they are and becomes the stack's ``black``.
    board_reflectance
        Reflectance of the board that ``white`` shows, one number or one per band; default: 1.
    intensities
        Strength of each light, ``(obs,)`` or ``(obs, band)``, or a text file of these; default:
        those of the light file, else ``light_intensities.txt`` beside it, else 1.
    pattern
        Several files per observation (a filter wheel): ``"{name}_{band}.tif"``, or a list of
        patterns in band order.
    bands
        Names of the bands; with ``{band}`` in the pattern also what stands in the file names.
    pitch_mm
        Width of a pixel on the painting in mm (needed by point lights).
    region
        Only this part: ``(top, left, height, width)`` in pixels. Of TIFF and OpenEXR files only the
        strips, tiles or blocks of rows that it touches are read; the samples are those of a crop of
        the whole, bit for bit.
    layer
        The layer of OpenEXR files with several.
    strict
        Raise :class:`~impasto.CorruptInputError` where anything would have to be repaired.
    max_pixels
        Photographs with more pixels are refused before decoding.

    Returns
    -------
    Stack
        Linear integers stay integers, also with a black level; everything else becomes float32.
        After white-board or dark frames, clipped samples are +inf.

    Raises
    ------
    CorruptInputError
        A damaged file, named.
    ArgumentError
        Files or options that do not fit together, with both sides named; options for photographs
        where ``path`` is an ``.npz`` or ``.zarr``, which holds a finished stack.
    """
    path = Path(path)
    if not path.exists():
        raise ArgumentError(f"path: {path} does not exist")
    given: dict[str, Any] = {
        "lights": lights, "images": images, "mask": mask, "saturation": saturation,
        "white": white, "dark": dark, "board_reflectance": board_reflectance,
        "intensities": intensities, "pattern": pattern, "bands": bands, "pitch_mm": pitch_mm,
        "layer": layer, "encoding": encoding,
    }  # fmt: skip
    if path.suffix.lower() == ".npz":
        from impasto.io.session.archive import read_archive

        return read_archive(path, given, region)
    if path.suffix.lower() == ".zarr":
        from impasto.io.session.stored import read_stored

        return read_stored(path, given, region)
    given |= {"region": region, "strict": strict, "max_pixels": max_pixels}
    if is_session(path):
        return SessionPhotographs.verified(path, given).read()
    return read_photographs(path, **given)
