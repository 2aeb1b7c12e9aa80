"""What a written file loses: colour differences between what it shows and what impasto shows.

Every exporter reads back what it has written, with its 8-bit codes and its compression, lights that
as the programs for the format do, and compares with :func:`impasto.render` in CIEDE2000, over the
same lights and views for all formats.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impasto.colour import Display, delta_e, lab_from_xyz
from impasto.export.source import Direction, Map, Source
from impasto.io.images.write import write_json

LIGHTS = ((45, 70), (225, 70), (0, 45), (90, 45), (180, 45), (270, 45), (135, 25), (315, 25))
"""Azimuth and elevation in degrees of the lights of a view from the front: steep, as in the papers,
and raking."""
OBLIQUE = (((0, 60), (180, 60)), ((0, 60), (90, 45)), ((90, 60), (270, 60)), ((90, 60), (180, 30)))
"""View and light, 30 degrees off the normal: in the mirror direction, and beside it."""
REPORT = "loss.json"
_SAMPLED = 10_000
"""Pixels of each picture that are compared, about."""
_PERCENTILES = (50, 95, 99)

Shown = Callable[[Direction, Direction | None, NDArray[np.intp]], Map]
"""What a file shows: linear sRGB ``(3, n)`` of the pixels with these flat numbers under a light,
from a view (None: the front)."""


@dataclass(frozen=True)
class SceneLoss:
    """One light and view, in degrees (azimuth, elevation), and its CIEDE2000 percentiles."""

    light: tuple[float, float]
    view: tuple[float, float]
    p50: float
    p95: float
    p99: float


@dataclass(frozen=True)
class LossReport:
    """What a file shows differently from :func:`impasto.render`, and what it cannot hold.

    Attributes
    ----------
    format
        Its name.
    p50, p95, p99
        CIEDE2000 percentiles over pixels of all scenes that the format has; None for formats that
        hold geometry alone.
    oblique_p50, oblique_p95, oblique_p99
        The same from the side; None for formats of one view.
    kept, lost
        In words: what is in the file, and what the format cannot hold.
    scenes
        Each light and view.
    files
        Name and bytes of each file.
    measured
        Numbers that are no colours: angles in degrees, heights in mm.
    """

    format: str
    kept: tuple[str, ...]
    lost: tuple[str, ...]
    p50: float | None = None
    p95: float | None = None
    p99: float | None = None
    oblique_p50: float | None = None
    oblique_p95: float | None = None
    oblique_p99: float | None = None
    scenes: tuple[SceneLoss, ...] = ()
    files: tuple[tuple[str, int], ...] = ()
    measured: dict[str, float] = field(default_factory=dict)

    def to_dict(self) -> dict[str, Any]:
        """For JSON; what is None is left out."""
        content = {name: value for name, value in asdict(self).items() if value is not None}
        content["scenes"] = [asdict(one) for one in self.scenes]
        return {"kind": "impasto loss", "version": 1, **content}

    def save(self, path: str | Path) -> None:
        """Write it as JSON."""
        write_json(path, self.to_dict())

    @property
    def summary(self) -> str:
        """One line: the percentiles of the colours, or the other numbers."""
        if self.p50 is None:
            return ", ".join(
                f"{name.replace('_', ' ')} {v:.3g}" for name, v in self.measured.items()
            )
        front = f"dE00 {self.p50:.2f} median, {self.p95:.2f} p95, {self.p99:.2f} p99"
        if self.oblique_p50 is None:
            return front + " from the front"
        return f"{front}; from the side {self.oblique_p50:.2f}, {self.oblique_p95:.2f}"

    def __str__(self) -> str:
        lines = [f"{self.format}: {self.summary}"]
        lines += [f"  kept  {one}" for one in self.kept]
        lines += [f"  lost  {one}" for one in self.lost]
        return "\n".join(lines)


def measure(source: Source, shown: Shown, *, oblique: bool) -> dict[str, Any]:
    """The colours of a :class:`LossReport`, by lighting what was read back.

    Parameters
    ----------
    source
        What was exported.
    shown
        What the file shows.
    oblique
        Whether it can be seen from the side.
    """
    return measure_parts([(source, shown)], oblique=oblique)


def measure_parts(parts: Sequence[tuple[Source, Shown]], *, oblique: bool) -> dict[str, Any]:
    """The same over several parts of a painting, each with what is shown of it."""
    found: list[SceneLoss] = []
    pooled: dict[bool, list[NDArray[np.float64]]] = {False: [], True: []}
    places = [sampled(source.known, _SAMPLED // len(parts)) for source, _ in parts]
    for light, view in scenes(oblique=oblique):
        towards = None if view is None else direction(*view)
        differences = []
        for (source, shown), at in zip(parts, places, strict=True):
            reference = source.linear(direction(*light), towards).reshape(3, -1)[:, at]
            differences.append(
                delta_e(seen(reference), seen(shown(direction(*light), towards, at)))
            )
        difference = np.concatenate(differences)
        pooled[view is not None].append(difference)
        p50, p95, p99 = percentiles(difference)
        found.append(SceneLoss(light, (0.0, 90.0) if view is None else view, p50, p95, p99))
    names = [f"p{one}" for one in _PERCENTILES]
    result: dict[str, Any] = dict(
        zip(names, percentiles(np.concatenate(pooled[False])), strict=True)
    )
    if pooled[True]:
        side = percentiles(np.concatenate(pooled[True]))
        result |= {f"oblique_{name}": one for name, one in zip(names, side, strict=True)}
    return result | {"scenes": tuple(found)}


def scenes(*, oblique: bool) -> Iterator[tuple[tuple[float, float], tuple[float, float] | None]]:
    """Lights with their views (None: the front)."""
    for light in LIGHTS:
        yield light, None
    if oblique:
        for view, light in OBLIQUE:
            yield light, view


def direction(azimuth: float, elevation: float) -> Direction:
    """The unit vector of two angles in degrees."""
    turn, rise = math.radians(azimuth), math.radians(elevation)
    return (math.cos(rise) * math.cos(turn), math.cos(rise) * math.sin(turn), math.sin(rise))


def sampled(known: NDArray[np.bool_], count: int = _SAMPLED) -> NDArray[np.intp]:
    """Flat numbers of about so many known pixels, evenly spread."""
    every = np.flatnonzero(known)
    # A step that shares no factor with the columns visits all of them.
    step = max(1, every.size // max(count, 1))
    while step > 1 and math.gcd(step, known.shape[1]) > 1:
        step += 1
    return np.asarray(every[::step], dtype=np.intp)


def seen(linear: Map) -> NDArray[np.float64]:
    """CIELAB ``(3, n)`` of linear sRGB, clipped to the display."""
    display = Display.named("srgb")
    xyz = np.tensordot(display.xyz_from_linear, np.clip(linear, 0.0, 1.0), axes=1)
    return lab_from_xyz(xyz, "D65")


def percentiles(difference: NDArray[np.float64]) -> list[float]:
    """Those of every report: 50, 95 and 99."""
    return [float(one) for one in np.percentile(difference, _PERCENTILES)]


def written(files: list[Path], folder: Path) -> tuple[tuple[str, int], ...]:
    """Names below a folder and bytes."""
    return tuple(
        (path.relative_to(folder).as_posix(), path.stat().st_size) for path in sorted(files)
    )
