"""The rig of a stack: its lights, their strengths, the width of a pixel."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from impasto.errors import ArgumentError, CorruptInputError
from impasto.io.files import read_text
from impasto.io.images import ImageHeader
from impasto.io.lights import LightFile, read_lights
from impasto.io.notes import Notebook
from impasto.io.session.frames import Region
from impasto.io.session.observations import find_lights, is_light_file
from impasto.lights import Light, PointLight
from impasto.refinement import RigRefinement
from impasto.rig import Rig, Views, viewpoints

_STRENGTHS = "light_intensities.txt"
_LONGEST = 60
"""Characters of a wrong line that are shown."""


@dataclass(frozen=True, eq=False)
class ListedLights:
    """The lights as known before a photograph is opened.

    Parameters
    ----------
    source
        The file (or folder) to name when something does not fit.
    names
        The photograph of each light, where known.
    lights, views, view_positions
        One per listed observation; ``views`` is None for a frontal camera, positions are NaN for
        a distant one.
    intensities
        ``(n,)`` or ``(n, band)``, where the light file knows them.
    pitch_mm, width_mm
        Width of a pixel / of the picture on the painting, where known.
    refinement
        What a refined rig says of itself.
    """

    source: Path
    names: tuple[str, ...] | None
    lights: tuple[Light, ...]
    views: NDArray[np.float64] | None = None
    view_positions: NDArray[np.float64] | None = None
    intensities: NDArray[np.float64] | None = None
    pitch_mm: float | None = None
    width_mm: float | None = None
    refinement: RigRefinement | None = None


def listed_lights(
    path: Path,
    lights: str | Path | LightFile | Rig | ArrayLike | None,
    notebook: Notebook,
    names: tuple[str, ...] | None = None,
) -> ListedLights:
    """The lights of ``path`` (a light file or a folder), replaced by ``lights`` if given.

    ``names`` are those of the photographs in a folder, for lights that name none.
    """
    if path.is_file() and not is_light_file(path):
        raise ArgumentError(
            f"path: {path} is neither a light file (.lp, .relight, .dome, .txt, .csv, .json), "
            "an .npz nor a folder of photographs"
        )
    if isinstance(lights, LightFile):
        return _from_file(lights, notebook)
    if isinstance(lights, str | Path):
        return _from_file(read_lights(lights, strict=notebook.strict), notebook)
    if lights is None:
        if path.is_dir():
            return _from_file(find_lights(path, notebook), notebook)
        return _from_file(read_lights(path, strict=notebook.strict), notebook)
    rig = lights if isinstance(lights, Rig) else Rig(lights)
    if path.is_file():
        names = read_lights(path, strict=notebook.strict).names
    if names is not None and len(names) != len(rig):
        raise ArgumentError(f"lights: {len(rig)} given, {path} lists {len(names)} photographs")
    return ListedLights(
        path,
        names,
        rig.lights,
        views=rig.views,
        view_positions=rig.view_positions,
        pitch_mm=rig.pitch_mm,
        refinement=rig.refinement,
    )


def _from_file(file: LightFile, notebook: Notebook) -> ListedLights:
    notebook.extend(file.notes)
    return ListedLights(
        file.path,
        file.names,
        file.lights,
        views=file.views,
        view_positions=file.view_positions,
        intensities=file.intensities,
        pitch_mm=file.pitch_mm,
        width_mm=file.width_mm,
    )


def build_rig(
    listed: ListedLights,
    kept: Sequence[int],
    band_count: int,
    header: ImageHeader,
    area: Region | None,
    notebook: Notebook,
    *,
    intensities: str | Path | ArrayLike | None,
    pitch_mm: float | None,
) -> tuple[Rig, NDArray[np.float64] | None]:
    """The rig of the kept observations, and ``(obs, band)`` gains where bands differ."""
    picked: list[Light] = [listed.lights[i] for i in kept]
    gains = None
    strengths, where = _strengths(listed, intensities, notebook)
    if strengths is not None:
        strengths = _check_strengths(strengths, where, len(listed.lights), kept, band_count)
        if strengths.ndim == 2:
            gains = strengths
        else:
            pairs = zip(picked, strengths.tolist(), strict=True)
            picked = [replace(light, intensity=strength) for light, strength in pairs]
    pitch = listed.pitch_mm if pitch_mm is None else pitch_mm
    if pitch is None and listed.width_mm:
        pitch = listed.width_mm / header.width
    dx = dy = 0.0
    if area is not None and pitch is not None:
        top, left, height, width = area
        dx = (left + width / 2 - header.width / 2) * pitch
        dy = -(top + height / 2 - header.height / 2) * pitch
        picked = [a.seen_from(dx, dy) if isinstance(a, PointLight) else a for a in picked]
    views: Views | None = None
    if listed.views is not None:
        views = listed.views[list(kept)]
        if listed.view_positions is not None:
            views = viewpoints(views, listed.view_positions[list(kept)] - (dx, dy, 0.0))
    return Rig(picked, views=views, pitch_mm=pitch, refinement=listed.refinement), gains


def without_falloff(rig: Rig) -> Rig:
    """The rig of samples divided by a white board: equal lights and no fall-off."""
    lights = [
        replace(light, intensity=1.0, falloff=False)
        if isinstance(light, PointLight)
        else replace(light, intensity=1.0)
        for light in rig.lights
    ]
    return rig.with_lights(lights)


def _check_strengths(
    strengths: NDArray[np.float64], where: str, count: int, kept: Sequence[int], band_count: int
) -> NDArray[np.float64]:
    """``(obs,)`` or ``(obs, band)`` of the kept observations."""
    if strengths.ndim == 0:
        strengths = np.full(count, float(strengths))
    if strengths.ndim > 2 or len(strengths) not in {count, len(kept)}:
        raise ArgumentError(
            f"intensities: expected one row for each of {count} lights, found shape "
            f"{strengths.shape}{where}"
        )
    if not (np.isfinite(strengths) & (strengths > 0)).all():
        raise ArgumentError(f"intensities: expected positive numbers only{where}")
    if len(strengths) == count:
        strengths = strengths[list(kept)]
    if strengths.ndim == 2 and bool((strengths == strengths[:, :1]).all()):
        return np.ascontiguousarray(strengths[:, 0])
    if strengths.ndim == 2 and strengths.shape[1] != band_count:
        raise ArgumentError(
            f"intensities: {strengths.shape[1]} per light{where}, the photographs have "
            f"{band_count} bands"
        )
    return strengths


def _strengths(
    listed: ListedLights, intensities: Any, notebook: Notebook
) -> tuple[NDArray[np.float64] | None, str]:
    """The strengths, if known, and their source, for messages."""
    if intensities is None:
        if listed.intensities is not None:
            notebook.say("intensities", listed.source, "light strengths taken from this file")
            return listed.intensities, f" in {listed.source}"
        folder = listed.source if listed.source.is_dir() else listed.source.parent
        if not (folder / _STRENGTHS).is_file():
            return None, ""
        intensities = folder / _STRENGTHS
        notebook.say("intensities", intensities, "used as the strengths of the lights")
    if not isinstance(intensities, str | Path):
        return np.asarray(intensities, dtype=np.float64), ""
    path = Path(intensities)
    return read_strengths(path), f" in {path}"


def read_strengths(path: Path) -> NDArray[np.float64]:
    """``(light,)`` or ``(light, band)``: the numbers of a text file, one row for each light."""
    rows: list[list[float]] = []
    for number, line in enumerate(read_text(path).splitlines(), start=1):
        words = line.replace(",", " ").split()
        try:
            row = [float(word) for word in words]
        except ValueError:
            raise _no_strengths(path, number, line) from None
        if row and rows and len(row) != len(rows[0]):
            raise _no_strengths(path, number, line, f", {len(rows[0])} in each")
        rows += [row] if row else []
    table = np.array(rows, dtype=np.float64)
    return table[:, 0] if table.ndim == 2 and table.shape[1] == 1 else table


def _no_strengths(path: Path, number: int, line: str, more: str = "") -> CorruptInputError:
    whole = line.strip()
    found = repr(whole[:_LONGEST]) + ("..." if len(whole) > _LONGEST else "")
    return CorruptInputError(
        path,
        "expected the strengths of the lights, one row of numbers for each light, in the order of "
        f"the lights{more}; found in line {number}: {found}",
    )
