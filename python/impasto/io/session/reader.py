"""`read_stack`: from files on a disk to one linear stack."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from impasto._internal.waiting import wait_for
from impasto.encoding import Encoding
from impasto.errors import ArgumentError
from impasto.io.images import MAX_PIXELS, open_picture
from impasto.io.lights import LightFile
from impasto.io.notes import Notebook
from impasto.io.session.codes import read_codes
from impasto.io.session.curve import Photographs, choose_curve
from impasto.io.session.frames import (
    Calibration,
    FrameSource,
    Region,
    crop,
    find_board,
    frame_paths,
    picture_codes,
    read_dark,
)
from impasto.io.session.observations import Observations, find_observations
from impasto.io.session.rigs import build_rig, listed_lights, without_falloff
from impasto.rig import Rig
from impasto.stack import DIVIDED, Stack


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
        a folder of photographs, an ``.npz`` written by :func:`impasto.io.write_stack`, or a
        ``.zarr`` made by :func:`impasto.ingest`.
    lights
        The lights, where ``path`` is a folder: a light file, ``(obs, 3)`` directions or a
        :class:`~impasto.Rig`; default: the folder's only light file.
    images
        The folder of the photographs; default: that of ``path``.
    encoding
        How linear light became the files' codes: ``"linear"``, ``"srgb"``, a gamma such as
        ``"2.2"``, or ``"auto"`` to estimate it from the photographs themselves (see
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
    notebook = Notebook(strict)
    if not path.exists():
        raise ArgumentError(f"path: {path} does not exist")
    if path.suffix.lower() in {".npz", ".zarr"}:
        given = {
            "lights": lights, "images": images, "mask": mask, "saturation": saturation,
            "white": white, "dark": dark, "board_reflectance": board_reflectance,
            "intensities": intensities, "pattern": pattern, "bands": bands, "pitch_mm": pitch_mm,
            "layer": layer, "encoding": encoding,
        }  # fmt: skip
        if path.suffix.lower() == ".npz":
            from impasto.io.session.archive import read_archive

            return read_archive(path, given, region)
        from impasto.io.session.stored import read_stored

        return read_stored(path, given, region)
    listed = listed_lights(path, lights, notebook)
    folder = Path(images) if images is not None else (path if path.is_dir() else path.parent)
    excluded = [
        p for option in (mask, white, dark) if option is not None for p in frame_paths(option) or ()
    ]
    observations = find_observations(
        listed.names,
        len(listed.lights),
        folder,
        listed.source,
        notebook,
        pattern=pattern,
        bands=bands,
        excluded=excluded,
    )
    codes, header, area = read_codes(
        observations, notebook, region=region, layer=layer, max_pixels=max_pixels
    )
    shape: tuple[int, int, int] = codes.shape[1:]
    rig, gains = build_rig(
        listed,
        observations.kept,
        shape[0],
        header,
        area,
        notebook,
        intensities=intensities,
        pitch_mm=pitch_mm,
    )
    integer = codes.dtype.kind == "u"
    full = float(np.iinfo(codes.dtype).max) if integer else 1.0
    levels = _saturation(saturation, shape[0], full if integer else None)
    mask_array = _mask(mask, shape, area)
    strengths = rig.intensities[:, None] if gains is None else gains
    curve = choose_curve(
        encoding,
        Photographs(codes, full, rig.directions, strengths, levels, mask_array),
        header,
        observations.files[0][0],
        notebook,
    )
    calibration = Calibration(
        curve,
        levels,
        dark=None if dark is None else read_dark(dark, shape, curve, area, layer),
        board=None
        if white is None
        else find_board(white, observations.names, shape, area, listed.source, notebook),
        board_reflectance=_board(board_reflectance, shape[0], white),
        rig=rig,
        gains=gains,
        region=area,
        layer=layer,
    )
    if white is not None:
        rig = without_falloff(rig)
        notebook.say(DIVIDED, listed.source, "photographs divided by those of a white board")
    samples: NDArray[Any] = codes
    black: NDArray[np.float64] | float = 0.0
    if integer and calibration.only_level and dark is not None and frame_paths(dark) is None:
        # The stack subtracts it from the integers.
        black = np.asarray(dark, dtype=np.float64).reshape(-1)
    elif calibration.changes or curve.curve != "linear":
        samples = np.empty(codes.shape, np.float32)

        def develop(index: int) -> None:
            samples[index] = calibration.apply(codes[index], index)

        for index in range(len(codes)):
            wait_for(develop, index)
        levels = calibration.stored_saturation()
    return Stack(
        samples,
        lights=rig,
        bands=_bands(bands, observations, shape[0]),
        mask=mask_array,
        saturation=levels,
        black=black,
        encoding=curve,
        names=observations.names,
        notes=tuple(notebook.notes),
        sources=_sources(listed.source, observations, (mask, white, dark, intensities)),
    )


def _sources(
    lights: Path, observations: Observations, options: tuple[Any, ...]
) -> tuple[Path, ...]:
    named = [p for option in options if option is not None for p in frame_paths(option) or ()]
    every = [lights, *(path for files in observations.files for path in files), *named]
    return tuple(dict.fromkeys(path for path in every if path.is_file()))


def _saturation(
    saturation: ArrayLike | None, count: int, full: float | None
) -> NDArray[np.float64] | None:
    if saturation is None:
        saturation = full
    return None if saturation is None else _per_band(saturation, count, "saturation")


def _board(
    reflectance: ArrayLike | None, count: int, white: FrameSource | None
) -> NDArray[np.float64]:
    if reflectance is not None and white is None:
        raise ArgumentError("board_reflectance: needs photographs of the board (white=)")
    return _per_band(1.0 if reflectance is None else reflectance, count, "board_reflectance")


def _per_band(values: ArrayLike, count: int, name: str) -> NDArray[np.float64]:
    array = np.asarray(values, dtype=np.float64)
    if array.shape not in {(), (1,), (count,)} or not (array > 0).all():
        raise ArgumentError(
            f"{name}: expected one positive number or one per band ({count}), found {values!r}"
        )
    return np.ascontiguousarray(np.broadcast_to(array, (count,)))


def _mask(
    mask: str | Path | ArrayLike | None, shape: tuple[int, int, int], area: Region | None
) -> NDArray[np.bool_] | None:
    if mask is None:
        return None
    name = str(mask) if isinstance(mask, str | Path) else "the array"
    if isinstance(mask, str | Path):
        with open_picture(mask) as picture:
            # A mask of the region's size is one of the region.
            fits = picture.shape[1:] == shape[1:]
        array = picture_codes(Path(mask), None, None if fits else area).max(axis=0)
    else:
        array = np.asarray(mask)
        if array.shape != shape[1:]:
            array = crop(array, area)
    if array.shape != shape[1:]:
        raise ArgumentError(f"mask: {name} has shape {array.shape}, the photographs {shape[1:]}")
    chosen: NDArray[np.bool_] = array > 0
    if not chosen.any():
        raise ArgumentError("mask: is empty, no pixel belongs to the painting")
    return chosen


def _bands(
    bands: Sequence[str] | None, observations: Observations, count: int
) -> Sequence[str] | None:
    tokens = list(bands) if bands is not None else list(observations.band_names)
    if not tokens or len(tokens) == count:
        return tokens or None
    if len(tokens) * 3 == count:
        return [f"{token} {colour}" for token in tokens for colour in ("red", "green", "blue")]
    raise ArgumentError(f"bands: {len(tokens)} names for {count} bands")
