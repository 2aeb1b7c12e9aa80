"""`read_stack`: from files on a disk to one linear stack."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from impasto.encoding import Encoding
from impasto.errors import ArgumentError
from impasto.io.frames import (
    Calibration,
    FrameSource,
    Region,
    check_region,
    crop,
    find_board,
    frame_paths,
    read_dark,
)
from impasto.io.headers import MAX_PIXELS, ImageHeader
from impasto.io.images import load_image, read_image
from impasto.io.lights import LightFile
from impasto.io.notes import Notebook
from impasto.io.observations import Observations, find_observations
from impasto.io.rigs import build_rig, listed_lights, without_falloff
from impasto.rig import Rig
from impasto.stack import Stack
from impasto.waiting import wait_for

ASSUMED = Encoding("linear")
"""The tone curve where nobody says one: told by identity from one that somebody said."""


@dataclass(frozen=True, slots=True)
class _Options:
    region: Sequence[int] | None
    layer: str | None
    max_pixels: int


def read_stack(
    path: str | Path,
    *,
    lights: str | Path | LightFile | Rig | ArrayLike | None = None,
    images: str | Path | None = None,
    encoding: Encoding | str | None = ASSUMED,
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
    """Read the photographs of one painting and the lights they were taken under.

    Everything repaired, dropped or assumed on the way is listed in ``stack.notes`` and logged to
    ``impasto.io``.

    Parameters
    ----------
    path
        A light file (``.lp``, ``.relight``, ``.dome``, text, CSV, JSON) beside its photographs,
        a folder of photographs, or an ``.npz`` written by :func:`impasto.io.write_stack`.
    lights
        The lights, where ``path`` is a folder: a light file, ``(obs, 3)`` directions or a
        :class:`~impasto.Rig`; default: the folder's only light file.
    images
        The folder of the photographs; default: that of ``path``.
    encoding
        How linear light became the files' codes: ``"linear"`` (default), ``"srgb"``, a gamma
        such as ``"2.2"``, or ``"auto"`` to estimate it from the photographs themselves (the
        estimate is in the notes, see :func:`impasto.io.estimate_tone`), or None for what such
        files hold as a rule: sRGB in 8 bits, linear light in more.
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
        Dark or ambient frames (averaged), or a black level in codes.
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
        Only this part: ``(top, left, height, width)`` in pixels.
    layer
        The layer of OpenEXR files with several.
    strict
        Raise :class:`~impasto.CorruptInputError` where anything would have to be repaired.
    max_pixels
        Photographs with more pixels are refused before decoding.

    Returns
    -------
    Stack
        Linear 8 and 16-bit files stay integers; everything else becomes float32. After white-board
        or dark frames, clipped samples are +inf.

    Raises
    ------
    CorruptInputError
        A damaged file, named.
    ArgumentError
        Files or options that do not fit together, with both sides named; options for photographs
        where ``path`` is an ``.npz``, which holds a finished stack.
    """
    path = Path(path)
    notebook = Notebook(strict)
    if not path.exists():
        raise ArgumentError(f"path: {path} does not exist")
    if path.suffix.lower() == ".npz":
        from impasto.io.archive import read_archive

        given = {
            "lights": lights, "images": images, "mask": mask, "saturation": saturation,
            "white": white, "dark": dark, "board_reflectance": board_reflectance,
            "intensities": intensities, "pattern": pattern, "bands": bands, "pitch_mm": pitch_mm,
            "region": region, "layer": layer, "encoding": None if encoding is ASSUMED else encoding,
        }  # fmt: skip
        return read_archive(path, given)
    options = _Options(region, layer, max_pixels)
    listed = listed_lights(path, lights, notebook)
    folder = Path(images) if images is not None else (path if path.is_dir() else path.parent)
    aside = [
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
        aside=aside,
    )
    codes, headers, area = _codes(observations, options)
    _orientation(headers, notebook)
    shape: tuple[int, int, int] = codes.shape[1:]
    rig, gains = build_rig(
        listed,
        observations.kept,
        shape[0],
        headers[0],
        area,
        notebook,
        intensities=intensities,
        pitch_mm=pitch_mm,
    )
    integer = codes.dtype.kind == "u"
    full = float(np.iinfo(codes.dtype).max) if integer else 1.0
    levels = _saturation(saturation, shape[0], full if integer else None)
    mask_array = _mask(mask, shape, area)
    curve = _curve(encoding, codes, full, rig, gains, levels, mask_array, observations, notebook)
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
    samples: NDArray[Any] = codes
    if calibration.changes or curve.curve != "linear":
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


def _codes(
    observations: Observations, options: _Options
) -> tuple[NDArray[Any], list[ImageHeader], Region | None]:
    """Every file decoded into one array ``(obs, band, y, x)`` of codes."""
    headers: list[ImageHeader] = []
    area: Region | None = None
    out: NDArray[Any] | None = None
    widths: list[int] = []
    for index, files in enumerate(observations.files):
        band = 0
        for position, path in enumerate(files):
            header, planes = wait_for(
                load_image, path, layer=options.layer, max_pixels=options.max_pixels
            )
            headers.append(header)
            if out is None and position == 0:
                area = check_region(options.region, (header.height, header.width))
            reference = headers[position]
            _same(header, reference, planes, widths[position] if index else None)
            if _size(header) != _size(headers[0]):
                _refuse(header, headers[0], "size", _size(header), _size(headers[0]))
            planes = crop(planes, area)
            if index == 0:
                # The first observation tells how many bands there are in all.
                widths.append(len(planes))
                out = planes if out is None else np.concatenate([out, planes])
            else:
                assert out is not None
                wait_for(np.copyto, out[index, band : band + len(planes)], planes)
            band += len(planes)
        if index == 0:
            assert out is not None
            out = _allocate(out, len(observations.files), files[0])
    assert out is not None
    return out, headers, area


def _allocate(first: NDArray[Any], count: int, path: Path) -> NDArray[Any]:
    needed = first.nbytes * count
    try:
        memory = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    except (AttributeError, ValueError, OSError):  # not every system tells
        memory = needed
    if needed > memory:
        raise ArgumentError(
            f"{path.parent}: {count} photographs need {needed / 1e9:.1f} GB, this machine has "
            f"{memory / 1e9:.1f} GB; read a part with region=(top, left, height, width)"
        )
    out = np.empty((count, *first.shape), first.dtype)
    wait_for(np.copyto, out[0], first)
    return out


def _size(header: ImageHeader) -> str:
    return f"{header.width} x {header.height} pixels"


def _same(
    header: ImageHeader, reference: ImageHeader, planes: NDArray[Any], bands: int | None
) -> None:
    if _size(header) != _size(reference):
        _refuse(header, reference, "size", _size(header), _size(reference))
    if header.dtype != reference.dtype:
        _refuse(header, reference, "sample type", header.dtype, reference.dtype)
    if bands is not None and len(planes) != bands:
        _refuse(header, reference, "number of bands", len(planes), bands)


def _refuse(header: ImageHeader, other: ImageHeader, what: str, found: Any, expected: Any) -> None:
    raise ArgumentError(
        f"photographs differ in {what}: {header.path} has {found}, {other.path} has {expected}; "
        "all photographs of a stack come from one camera at one setting, uncropped"
    )


def _orientation(headers: list[ImageHeader], notebook: Notebook) -> None:
    """EXIF orientation is never applied: rotating one photograph alone would misalign the stack."""
    first = headers[0]
    for header in headers:
        if header.orientation != first.orientation:
            notebook.warn(
                "orientation",
                header.path,
                f"EXIF orientation {header.orientation}, {first.path.name} has "
                f"{first.orientation}: ignored in all, pixels are used as stored",
            )
            return
    if first.orientation != 1:
        notebook.say(
            "orientation",
            first.path,
            f"EXIF orientation {first.orientation} ignored in all photographs: light directions "
            "refer to the pixels as stored",
        )


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
        raise ArgumentError(
            "board_reflectance: says nothing without photographs of the board (white=)"
        )
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
    array = read_image(mask).max(axis=0) if isinstance(mask, str | Path) else np.asarray(mask)
    if array.shape != shape[1:]:
        array = crop(array, area)
    if array.shape != shape[1:]:
        raise ArgumentError(f"mask: {name} has shape {array.shape}, the photographs {shape[1:]}")
    chosen: NDArray[np.bool_] = array > 0
    if not chosen.any():
        raise ArgumentError("mask: is empty, no pixel belongs to the painting")
    return chosen


def _curve(
    encoding: Encoding | str | None,
    codes: NDArray[Any],
    full: float,
    rig: Rig,
    gains: NDArray[np.float64] | None,
    levels: NDArray[np.float64] | None,
    mask: NDArray[np.bool_] | None,
    observations: Observations,
    notebook: Notebook,
) -> Encoding:
    if encoding is ASSUMED:
        encoding = ASSUMED.curve
    if isinstance(encoding, Encoding):
        return encoding
    if encoding is None:
        curve = "srgb" if full == 255.0 else "linear"
        bits = "8-bit files" if full == 255.0 else "files with more than 8 bits"
        folder = observations.files[0][0].parent
        notebook.say("encoding", folder, f"{bits}, taken to hold {curve} values")
        return Encoding(curve, full)
    if str(encoding).lower() != "auto":
        told = Encoding(encoding, full)
        first = observations.files[0][0]
        if told.curve == "linear" and first.suffix.lower() in {".jpg", ".jpeg", ".jpe"}:
            notebook.warn(
                "encoding",
                first.parent,
                "JPEGs, taken to hold linear light; most hold sRGB (encoding=)",
            )
        return told
    from impasto.io.tone import estimate_tone

    strengths = rig.intensities[:, None] if gains is None else gains
    estimate = estimate_tone(
        codes, rig.directions, white=full, saturation=levels, mask=mask, intensities=strengths
    )
    notebook.take(replace(estimate, where=str(observations.files[0][0].parent)))
    return Encoding(estimate.curve, full)


def _bands(
    bands: Sequence[str] | None, observations: Observations, count: int
) -> Sequence[str] | None:
    tokens = list(bands) if bands is not None else list(observations.band_names)
    if not tokens or len(tokens) == count:
        return tokens or None
    if len(tokens) * 3 == count:
        return [f"{token} {colour}" for token in tokens for colour in ("red", "green", "blue")]
    raise ArgumentError(f"bands: {len(tokens)} names for {count} bands")
