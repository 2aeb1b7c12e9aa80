"""From the files of photographs, lights and calibration frames to one linear stack."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from impasto._internal.checks import reachable
from impasto._internal.recycling import empty
from impasto._internal.waiting import wait_for
from impasto.encoding import Encoding
from impasto.errors import ArgumentError
from impasto.io.images import MAX_PIXELS, open_picture
from impasto.io.lights import LightFile
from impasto.io.lights.tables import unit_views
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
    resampled_dark,
)
from impasto.io.session.geometry import Geometry
from impasto.io.session.observations import Observations, find_observations
from impasto.io.session.rigs import ListedLights, build_rig, listed_lights, without_falloff
from impasto.rig import Rig
from impasto.stack import DIVIDED, Stack

Guard: TypeAlias = Callable[[Sequence[Path], Notebook], None]
"""Sees the photographs before any of them is opened; raises where one must not be read."""


def read_photographs(
    path: Path,
    *,
    lights: str | Path | LightFile | Rig | ArrayLike | None = None,
    images: str | Path | None = None,
    encoding: Encoding | str | None = None,
    mask: str | Path | ArrayLike | None = None,
    saturation: ArrayLike | None = None,
    white: FrameSource | None = None,
    dark: FrameSource | None = None,
    board_reflectance: ArrayLike | None = None,
    board_exposure: ArrayLike | None = None,
    intensities: str | Path | ArrayLike | None = None,
    pattern: str | Sequence[str] | None = None,
    bands: Sequence[str] | None = None,
    pitch_mm: float | None = None,
    region: Sequence[int] | None = None,
    layer: str | None = None,
    strict: bool = False,
    max_pixels: int = MAX_PIXELS,
    names: tuple[str, ...] | None = None,
    guard: Guard | None = None,
    geometry: Geometry | None = None,
) -> Stack:
    """As :func:`impasto.read_stack`, for a light file or a folder of photographs.

    ``names`` are those of the photographs in a folder, where ``lights`` names none.
    ``board_exposure`` is the exposure of the photographs over that of ``white``. ``geometry``
    resamples them; it has their tone curve and the code from which they are clipped.
    """
    notebook = Notebook(strict)
    listed, observations = find_photographs(
        path,
        notebook,
        lights=lights,
        images=images,
        mask=mask,
        white=white,
        dark=dark,
        pattern=pattern,
        bands=bands,
        names=names,
        others=() if geometry is None or geometry.brackets is None else geometry.brackets.others,
    )
    if guard is not None:
        guard([path for files in observations.files for path in files], notebook)
    codes, header, area = read_codes(
        observations, notebook,
        region=region, layer=layer, max_pixels=max_pixels, geometry=geometry,
    )  # fmt: skip
    shape: tuple[int, int, int] = codes.shape[1:]
    if geometry is not None:
        listed = _seen_by(geometry, listed, observations)
        pitch_mm = geometry.pitch_mm if pitch_mm is None else pitch_mm
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
    if geometry is None:
        levels = _saturation(saturation, shape[0], full if integer else None)
    else:
        levels = _saturation(None, shape[0], _clipped_from(observations, geometry, layer))
        encoding = Encoding("linear", full)
    mask_array = _mask(mask, shape, area)
    strengths = rig.intensities[:, None] if gains is None else gains
    curve = choose_curve(
        encoding,
        Photographs(codes, full, rig.directions, strengths, levels, mask_array),
        header,
        observations.files[0][0],
        notebook,
    )

    def black_frame(dark: FrameSource) -> NDArray[np.float32]:
        if geometry is None:
            return read_dark(dark, shape, curve, area, layer)
        stored = geometry.stored_curve(observations.files[0][0])
        return resampled_dark(dark, geometry, shape[0], stored, layer)

    calibration = Calibration(
        curve,
        levels,
        dark=None if dark is None else black_frame(dark),
        board=None
        if white is None
        else _board_frames(white, observations, shape, area, listed, notebook, geometry),
        board_reflectance=_board(board_reflectance, shape[0], white),
        board_exposure=_exposures(board_exposure, len(listed.lights), observations.kept, white),
        rig=rig,
        # Each board is lit by the lamp of its photograph: strengths cancel.
        gains=None if white is not None else gains,
        region=area,
        layer=layer,
        geometry=geometry,
        photographs=[files[0].name for files in observations.files],
    )
    if white is not None:
        rig = without_falloff(rig)
        notebook.say(DIVIDED, listed.source, "photographs divided by those of a white board")
    samples: NDArray[Any] = codes
    black: NDArray[np.float64] | float = 0.0
    if integer and calibration.only_level and dark is not None and frame_paths(dark) is None:
        # The stack subtracts it from the integers.
        black = np.asarray(dark, dtype=np.float64).reshape(-1)
        if geometry is not None:
            assert calibration.dark is not None
            black = full * calibration.dark[:, 0, 0].astype(np.float64)
    elif calibration.changes or curve.curve != "linear":
        samples = empty(codes.shape, np.float32)

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


def find_photographs(
    path: Path,
    notebook: Notebook,
    *,
    lights: Any = None,
    images: str | Path | None = None,
    mask: Any = None,
    white: FrameSource | None = None,
    dark: FrameSource | None = None,
    pattern: str | Sequence[str] | None = None,
    bands: Sequence[str] | None = None,
    names: tuple[str, ...] | None = None,
    others: Sequence[Path] = (),
) -> tuple[ListedLights, Observations]:
    """The lights and the files of each photograph, none of which is opened.

    ``others`` are pictures in the folder that are no photographs by themselves.
    """
    listed = listed_lights(path, lights, notebook, names)
    folder = Path(images) if images is not None else (path if path.is_dir() else path.parent)
    excluded = list(others)
    excluded += [
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
    return listed, observations


def _board_frames(
    white: FrameSource,
    observations: Observations,
    shape: tuple[int, int, int],
    area: Region | None,
    listed: ListedLights,
    notebook: Notebook,
    geometry: Geometry | None,
) -> Sequence[Path] | NDArray[Any]:
    if geometry is not None and frame_paths(white) is None:
        raise ArgumentError(
            "white: with a lens, an alignment or brackets, boards are files; found an array"
        )
    return find_board(white, observations.names, shape, area, listed.source, notebook)


def _seen_by(geometry: Geometry, listed: ListedLights, observations: Observations) -> ListedLights:
    """With the places of the camera that an alignment knows, where the lights have no views."""
    kept = list(observations.kept)
    places = geometry.cameras([files[0].name for files in observations.files])
    if listed.views is not None or places is None:
        return listed
    views = np.tile(np.array([0.0, 0.0, 1.0]), (len(listed.lights), 1))
    eyes = places / np.linalg.norm(places, axis=1, keepdims=True)
    views[kept] = unit_views(eyes.tolist(), listed.source)
    positions = np.full(views.shape, np.nan)
    positions[kept] = places
    return replace(listed, views=views, view_positions=positions)


def _clipped_from(
    observations: Observations, geometry: Geometry, layer: str | None
) -> float | None:
    """The code from which resampled photographs are clipped."""
    with geometry.open(observations.files[0][0], layer) as picture:
        return picture.full


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
        return None if full is None else _per_band(full, count, "saturation")
    levels = _per_band(saturation, count, "saturation")
    if full is not None:
        reachable(levels, int(full))
    return levels


def _board(
    reflectance: ArrayLike | None, count: int, white: FrameSource | None
) -> NDArray[np.float64]:
    if reflectance is not None and white is None:
        raise ArgumentError("board_reflectance: needs photographs of the board (white=)")
    return _per_band(1.0 if reflectance is None else reflectance, count, "board_reflectance")


def _exposures(
    ratios: ArrayLike | None, lights: int, kept: Sequence[int], white: FrameSource | None
) -> NDArray[np.float64] | None:
    """``(obs,)`` exposures over those of the boards."""
    if ratios is None:
        return None
    if white is None:
        raise ArgumentError("board_exposure: needs photographs of the board (white=)")
    found = np.asarray(ratios, np.float64)
    if found.shape not in {(), (lights,)}:
        raise ArgumentError(
            f"board_exposure: expected one number, or one for each of {lights} lights, found "
            f"{found.size}"
        )
    return np.broadcast_to(found, (lights,))[list(kept)]


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
