"""Pixels of the merged painting from the frames that see them.

A frame's weight falls to zero at its edges, so that no frame begins or ends with a step
(feathering).
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impasto._internal.windows import Window, offset
from impasto.fit.normals import Normals
from impasto.fit.result import Sbrdf
from impasto.merge.frames import Frame
from impasto.merge.models import Model, as_maps
from impasto.merge.placement import Placement
from impasto.merge.resampling import REACH, Samples
from impasto.rig import Rig
from impasto.status import Status

Floats = NDArray[np.float64]
Maps = dict[str, NDArray[Any]]

VECTORS = ("normal", "normals.normal")
COLOURS = ("diffuse", "ambient", "normals.albedo")
ERRORS = re.compile(r"(normals\.)?(residual|sigma)")
"""Blended as variances: the error of a mean is no smaller than theirs, as frames may share it."""
LEAST = 1e-9
"""Added to strengths as weights: a lobe without any still has a width."""
LEVELS = ("normals.condition", "misfit")
CODES = re.compile(r"(normals\.)?status|normals\.(used|rejected)|lobes|tinted|converged|\w+_sigma")
"""Those of the frame that weighs most: what lies between two of them is none."""


@dataclass(frozen=True, eq=False)
class Mosaic:
    """Everything that a tile of the merged painting is made of.

    Attributes
    ----------
    frames, placements
        The frames, and where they lie in the merged painting.
    gains
        ``(frame, band)``.
    rotations
        ``(frame, 3, 3)`` of normals, after that of the placement.
    model
        What the merged painting is.
    shape
        Its rows and columns.
    rig
        That of the reference frame, with the origin of the merged painting.
    method
        How normals were estimated.
    """

    frames: Sequence[Frame]
    placements: Sequence[Placement]
    gains: Floats
    rotations: Floats
    model: Model
    shape: tuple[int, int]
    rig: Rig
    method: str

    def part(self, rows: slice, columns: slice) -> Sbrdf:
        """A part of the merged painting; its bits do not depend on which parts are made."""
        size = rows.stop - rows.start, columns.stop - columns.start
        seen = [
            found
            for index in range(len(self.frames))
            if (found := self._resampled(index, (rows, columns))) is not None
        ]
        template = as_maps(self.frames[0].window(slice(0, 1), slice(0, 1)), self.model)
        maps = _blended(seen, template, size[0] * size[1])
        shaped = {name: one.reshape(*one.shape[:-1], *size) for name, one in maps.items()}
        return self._result(shaped).placed(*offset((rows, columns), self.shape))

    def _result(self, maps: Maps) -> Sbrdf:
        stereo = {
            name.removeprefix("normals."): plane
            for name, plane in maps.items()
            if name.startswith("normals.")
        }
        own: dict[str, Any] = {
            name: plane for name, plane in maps.items() if not name.startswith("normals.")
        }
        return self.model.kind(
            **own,
            **self.model.numbers,
            normals=Normals(**stereo, method=self.method),
            rig=self.rig,
            bands=self.frames[0].bands,
        )

    def _resampled(self, index: int, part: Window) -> _Seen | None:
        """The maps of a frame at the pixels of a part that it covers."""
        frame, placement = self.frames[index], self.placements[index]
        rows, columns = part
        x, y = (
            one.ravel().astype(np.float64)
            for one in np.meshgrid(
                np.arange(columns.start, columns.stop), np.arange(rows.start, rows.stop)
            )
        )
        column, row = placement.back(x, y)
        height, width = frame.shape
        inside = (column > -0.5) & (column < width - 0.5) & (row > -0.5) & (row < height - 0.5)
        at = np.flatnonzero(inside)
        if not at.size:
            return None
        column, row = column[at], row[at]
        window = (
            slice(max(int(row.min()) - REACH, 0), min(int(row.max()) + REACH + 2, height)),
            slice(max(int(column.min()) - REACH, 0), min(int(column.max()) + REACH + 2, width)),
        )
        maps = as_maps(frame.window(*window), self.model)
        size = window[0].stop - window[0].start, window[1].stop - window[1].start
        samples = Samples.at(column - window[1].start, row - window[0].start, size)
        weight = np.minimum(column + 0.5, width - 0.5 - column) * np.minimum(
            row + 0.5, height - 0.5 - row
        )
        found = {name: _at(samples, name, plane, maps) for name, plane in maps.items()}
        turn = self.rotations[index] @ placement.rotation
        gain = self.gains[index]
        for name in VECTORS:
            found[name] = _rotated(turn, found[name])
        for name in COLOURS:
            if name in found:
                found[name] = found[name] * gain[:, None]
        for name in ("residual", "normals.residual"):
            found[name] = found[name] * gain.mean()
        if "specular" in found:
            found["specular"] = found["specular"] * _lobe_gain(gain, found)
        return _Seen(at, weight, found)


@dataclass(frozen=True, eq=False)
class _Seen:
    """Maps ``(..., n)`` of a frame at pixels of a part, and their weights ``(n,)``."""

    at: NDArray[np.intp]
    weight: Floats
    maps: Maps


def _rotated(turn: Floats, vectors: Floats) -> Floats:
    # No matrix product: its last bits may depend on how many columns it has.
    x, y, z = vectors
    return np.stack([row[0] * x + row[1] * y + row[2] * z for row in turn])


def _lobe_gain(gain: Floats, maps: Maps) -> Floats:
    """The gain per band of lobes with a strength per band, the mean gain of all others.

    One strength that was fitted to all bands is that of none of them.
    """
    if "tinted" not in maps:
        return gain[:, None]
    return np.where(maps["tinted"][:, None], gain[:, None], gain.mean())


def _at(samples: Samples, name: str, plane: NDArray[Any], maps: Maps) -> NDArray[Any]:
    """A map of a frame at pixels of the merged painting."""
    if CODES.fullmatch(name):
        return np.asarray(samples.picked(plane))
    flat = plane.reshape(-1, *plane.shape[-2:])
    if name in VECTORS or name in COLOURS:
        found = samples.interpolated(flat)
    elif plane.ndim >= 3 and "lobes" in maps:
        # Between pixels of one and two lobes there is none with one and a half.
        found = samples.alike(maps["lobes"], flat)
    else:
        # Errors and the like are no surface: nothing between two of them is outside of them.
        found = samples.alike(np.zeros(plane.shape[-2:], np.uint8), flat)
    return np.asarray(found.reshape(*plane.shape[:-2], -1))


def _blended(seen: Sequence[_Seen], template: Maps, count: int) -> Maps:
    """Maps ``(..., count)`` of all frames together."""
    heaviest = _Heaviest.of(seen, "status", count)
    stereo = _Heaviest.of(seen, "normals.status", count)
    maps: Maps = {}
    for name, plane in template.items():
        chosen = stereo if name.startswith("normals.") else heaviest
        leading = plane.shape[:-2]
        if CODES.fullmatch(name):
            maps[name] = chosen.picked(seen, name, leading, plane.dtype)
        elif ERRORS.fullmatch(name):
            square = _mean(seen, name, leading, count, chosen, power=2)
            maps[name] = np.sqrt(square).astype(np.float32)
        elif name in VECTORS:
            maps[name] = _unit(_mean(seen, name, leading, count, chosen))
        elif name in COLOURS or name in LEVELS:
            maps[name] = _mean(seen, name, leading, count, chosen).astype(np.float32)
    _known(maps, "", heaviest.status)
    _known(maps, "normals.", stereo.status)
    if "specular" in template:
        maps |= _lobes(seen, template, count, heaviest)
    return maps


@dataclass(frozen=True, eq=False)
class _Heaviest:
    """The frame that decides about a pixel: of those that know most of it, the heaviest one.

    Attributes
    ----------
    index
        ``(count,)`` among the frames; -1: none covers it.
    status
        ``(count,)`` its status; ``MASKED`` where there is none.
    """

    index: NDArray[np.intp]
    status: NDArray[np.uint8]

    @classmethod
    def of(cls, seen: Sequence[_Seen], name: str, count: int) -> _Heaviest:
        index = np.full(count, -1, np.intp)
        status = np.full(count, Status.MASKED, np.uint8)
        rank, weight = np.full(count, -1), np.zeros(count)
        for number, one in enumerate(seen):
            code = one.maps[name]
            own = np.where(code < Status.DARK, 2, np.where(code == Status.DARK, 1, 0))
            there = one.at
            better = (own > rank[there]) | ((own == rank[there]) & (one.weight > weight[there]))
            at = there[better]
            index[at], status[at] = number, code[better]
            rank[at], weight[at] = own[better], one.weight[better]
        return cls(index, status)

    def picked(
        self, seen: Sequence[_Seen], name: str, leading: tuple[int, ...], dtype: np.dtype[Any]
    ) -> NDArray[Any]:
        """A map of the deciding frames; what no frame covers is unknown."""
        if name.endswith("status"):
            return self.status
        nothing = np.nan if dtype.kind == "f" else 0
        found = np.full((*leading, len(self.index)), nothing, dtype)
        for number, one in enumerate(seen):
            own = self.index[one.at] == number
            found[..., one.at[own]] = one.maps[name][..., own]
        return found


def _mean(
    seen: Sequence[_Seen],
    name: str,
    leading: tuple[int, ...],
    count: int,
    chosen: _Heaviest,
    *,
    power: int = 1,
    factor: str | None = None,
) -> Floats:
    """The weighted mean of what frames know, of those that have as much as the deciding one."""
    total, weights = np.zeros((*leading, count)), np.zeros((*leading, count))
    status = "normals.status" if name.startswith("normals.") else "status"
    for one in seen:
        value = one.maps[name].astype(np.float64)
        known = np.isfinite(value)
        # A dark pixel's colours, 0, count only where no frame has more.
        known &= (one.maps[status] < Status.DARK) | (chosen.status[one.at] >= Status.DARK)
        share = np.where(known, one.weight, 0.0)
        value = np.where(known, value, 0.0)
        total[..., one.at] += share * (value * value if power == 2 else value)
        weights[..., one.at] += share
    return np.asarray(total / np.where(weights > 0.0, weights, np.nan))


def _unit(vectors: Floats) -> NDArray[np.float32]:
    length = np.sqrt(np.sum(vectors * vectors, axis=0))
    return np.asarray((vectors / np.where(length > 0.0, length, np.nan)).astype(np.float32))


def _known(maps: Maps, prefix: str, status: NDArray[np.uint8]) -> None:
    """NaN exactly where the status says so, whatever a frame knows that did not decide."""
    unknown, dark = status >= Status.DARK, status == Status.DARK
    for name, plane in maps.items():
        own = name.startswith("normals.") == (prefix == "normals.")
        if own and plane.dtype.kind == "f":
            plane[..., unknown] = np.nan
    for name in ("residual", "sigma"):
        maps[prefix + name][status == Status.EXACT] = np.nan
    colour = "normals.albedo" if prefix else "diffuse"
    maps[colour][:, dark] = 0.0


def _lobes(seen: Sequence[_Seen], template: Maps, count: int, chosen: _Heaviest) -> Maps:
    """Strengths and shapes, blended over frames with as many lobes as the deciding one.

    Widths are weighted by the strengths of their lobes. No logarithm: its last bits may depend on
    how many numbers it is taken of at once.
    """
    number = chosen.picked(seen, "lobes", (), np.dtype(np.uint8))
    lobes, bands = template["specular"].shape[:2]
    shapes = [name for name in ("gamma", "cxy", "cz", "exponent") if name in template]
    strength = np.zeros((lobes, bands, count))
    weights = np.zeros(count)
    sums = {name: np.zeros((lobes, count)) for name in shapes}
    masses = np.zeros((lobes, count))
    for one in seen:
        agree = (one.maps["lobes"] == number[one.at]) & (one.maps["status"] < Status.DARK)
        specular = one.maps["specular"]
        agree &= np.isfinite(specular).all(axis=(0, 1))
        share = np.where(agree, one.weight, 0.0)
        specular = np.where(agree, specular, 0.0)
        strength[..., one.at] += share * specular
        weights[one.at] += share
        mass = share * (specular.mean(axis=1) + LEAST)
        planes = {name: _additive(name, one.maps[name]) for name in shapes}
        mass *= np.all([np.isfinite(plane) for plane in planes.values()], axis=0)
        masses[:, one.at] += mass
        for name, plane in planes.items():
            sums[name][:, one.at] += np.where(mass > 0.0, plane, 0.0) * mass
    fine = masses > 0.0
    divisor = np.where(fine, masses, np.nan)
    found = {name: _from_additive(name, total / divisor) for name, total in sums.items()}
    if "cxy" in found:
        length = np.sqrt((found["cxy"] ** 2 + found["cz"] ** 2) / 2.0)
        found |= {name: found[name] / length for name in ("cxy", "cz")}
    maps: Maps = {name: plane.astype(np.float32) for name, plane in found.items()}
    maps["specular"] = (strength / np.where(weights > 0.0, weights, np.nan)).astype(np.float32)
    return maps


def _additive(name: str, plane: NDArray[Any]) -> Floats:
    """Shapes as what may be averaged: an exponent as the width that goes with it."""
    value = plane.astype(np.float64)
    return np.asarray(1.0 / np.sqrt(value)) if name == "exponent" else value


def _from_additive(name: str, value: Floats) -> Floats:
    return np.asarray(1.0 / (value * value)) if name == "exponent" else value
