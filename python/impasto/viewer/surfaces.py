"""A fitted painting, a surface or a store as the page shows it: what its shader needs to know."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from impasto._internal.waiting import floats
from impasto._internal.windows import Window
from impasto.bands import Camera
from impasto.effects import Decisions
from impasto.errors import ArgumentError
from impasto.fit.reflectance import ReflectanceEstimator, fit_reflectance
from impasto.fit.stored import StoredSbrdf
from impasto.height import integrate_normals
from impasto.lighting import metallic, prepare
from impasto.lights import DistantLight
from impasto.overview import visible
from impasto.plan import plan
from impasto.scene import Scene
from impasto.surface import Relightable, Surface
from impasto.viewer.colours import colours_of
from impasto.viewer.layout import QUALITY, Layout
from impasto.viewer.scales import FEWEST, READ, Scale, Scales, ScalesInMemory, ScalesOfStore, eye_of

FIRST_LIGHT = (0.0, 0.5**0.5, 0.5**0.5)
"""Direction of the lamp when the page opens: from above, as the pictures of ``impasto render``."""


@dataclass(frozen=True, eq=False)
class SurfacePainting:
    """Normals, colours and lobes, wherever their maps are.

    Attributes
    ----------
    maps
        Parts of it at all scales.
    planned
        Makes the plan of the first picture; None: none is made.
    eye
        From where pictures show it.
    pitch_mm
        Width of a pixel, if known.
    origin
        Where its middle lies in the painting, in pixels.
    bands
        Their names.
    reflectance
        Its spectra; None: bands are shown.
    beneath
        Whether there is a map of the share of the gloss that a varnish leaves as it is.
    quality
        Which of :data:`~impasto.viewer.layout.QUALITY` there are.
    read
        Largest factor at which they and the status are read; None: at every one.
    """

    maps: Scales
    planned: Callable[[], Decisions] | None
    eye: Any
    pitch_mm: float | None
    origin: list[float]
    bands: list[str]
    reflectance: Any = None
    beneath: bool = False
    quality: tuple[str, ...] = ()
    read: int | None = None

    @property
    def scales(self) -> tuple[Scale, ...]:
        """From the painting itself to the smallest."""
        return self.maps.scales

    @property
    def shown_bands(self) -> int | None:
        """How many bands photographs beside it must have; None: it is shown by spectra."""
        return len(self.maps.template.diffuse) if self.reflectance is None else None

    @property
    def layout(self) -> Layout:
        """How its maps lie in tiles."""
        return Layout.of(self.maps.template, beneath=self.beneath, quality=self.quality)

    def facts(self) -> dict[str, Any]:
        """Its entries of the document."""
        template = self.maps.template
        count = len(template.diffuse)
        return {
            "groups": self.layout.record(),
            "model": template.model,
            "lobes": [{"tinted": np.ndim(lobe.strength) == 3} for lobe in template.lobes],
            "index": float(template.index),
            "coated": bool(template.coated),
            "ambient": template.ambient is not None,
            "beneath": self.beneath,
            "quality": list(self.quality),
            "read": self.read,
            "relief": template.height is not None,
            "coefficients": count,
            "bands": self.bands,
            "origin": self.origin,
            "eye": eye_of(self.eye),
            "colours": colours_of(self.reflectance, count),
        }

    def effects(self) -> list[dict[str, str]]:
        """What a plan decides about the first picture, and why."""
        if self.planned is None:
            return []
        return [
            {"name": one.name, "decision": one.decision, "reason": one.reason}
            for one in self.planned().effects
        ]

    def known(self, scale: Scale, part: Window) -> bool:
        """Whether any pixel of a part has a normal."""
        return bool(np.isfinite(self.maps.part(scale, part).surface.normal).all(axis=0).any())

    def tiles(self, scale: Scale, parts: Sequence[Window]) -> Iterator[bytes]:
        """Parts as the page reads them; what lies around all of them is read once."""
        top, left = (min(part[axis].start for part in parts) for axis in (0, 1))
        below, beside = (max(part[axis].stop for part in parts) for axis in (0, 1))
        around = self.maps.part(scale, (slice(top, below), slice(left, beside)))
        layout = self.layout
        for rows, columns in parts:
            own = (
                slice(rows.start - top, rows.stop - top),
                slice(columns.start - left, columns.stop - left),
            )
            found = around.cut(own)
            yield layout.tile(found.surface, found.status, found.beneath, found.quality)


def painting_of_store(
    stored: StoredSbrdf, camera: Camera | None, pitch: float | None, threads: int | None
) -> SurfacePainting:
    """Of a store of any size: no map is read before a tile is asked for.

    ``camera``: of the photographs; spectra are estimated of the tiles that are looked at.
    ``pitch``: width of a pixel in mm, if the caller says it.
    """
    count = len(stored.bands)
    spectra = None if camera is None else ReflectanceEstimator(camera, stored.bands)
    chosen = None
    if spectra is None and count not in {1, 3}:
        chosen = [count - 1, count // 2, 0]
    # Jobs keep the statistics that a plan needs; of another store every map would be read.
    kept = stored.has_statistics and chosen is None and spectra is None
    maps = ScalesOfStore(stored, chosen, spectra, pitch)
    return SurfacePainting(
        maps=maps,
        planned=partial(stored.plan, _first_scene(), threads=threads) if kept else None,
        eye=stored[:1, :1].eye_in_mm(pitch),
        pitch_mm=stored.known_pitch_mm if pitch is None else pitch,
        origin=[float(value) for value in stored.rig.origin],
        bands=[stored.bands[band] for band in (range(count) if chosen is None else chosen)],
        reflectance=spectra,
        beneath=spectra is not None,
        quality=maps.quality,
        read=READ,
    )


def painting_in_memory(
    result: Relightable,
    reflectance: Any,
    camera: Camera | None,
    height: ArrayLike | None,
    pitch: float | None,
    threads: int | None,
) -> SurfacePainting:
    """Of a result that is loaded; arguments as of :class:`~impasto.viewer.Contents`."""
    spectra = result.spectra() if reflectance is None else reflectance
    if spectra is None and camera is not None:
        source: Any = result
        spectra = fit_reflectance(None, source, camera, threads=threads)
    lit: Any = visible(result, spectra)
    scene = _first_scene()
    surface = prepare(lit, scene, reflectance=spectra, threads=threads).surface
    surface = replace(surface, height=_relief(surface, height, pitch, threads))
    beneath: Any = None
    if spectra is not None:
        share = metallic(lit.surface())
        beneath = share if np.ndim(share) else np.full(surface.shape, share, np.float32)
        beneath = beneath if (beneath > 0.0).any() else None
    quality = {name: getattr(result, name) for name in QUALITY if hasattr(result, name)}
    return SurfacePainting(
        maps=ScalesInMemory(surface, getattr(result, "status", None), beneath, quality),
        planned=partial(plan, lit, scene, reflectance=spectra, fidelity="model", threads=threads),
        eye=lit.eye_in_mm(pitch),
        pitch_mm=lit.known_pitch_mm if pitch is None else pitch,
        origin=[float(value) for value in surface.origin],
        bands=[str(name) for name in getattr(lit, "bands", ())],
        reflectance=spectra,
        beneath=beneath is not None,
        quality=tuple(quality),
    )


def _relief(
    surface: Surface, height: ArrayLike | None, pitch: float | None, threads: int | None
) -> NDArray[np.float32] | None:
    """Heights in mm, or in pixels where their width is not known; None where nothing is known."""
    if height is not None:
        found = floats(height)
        if found.shape != surface.shape:
            raise ArgumentError(f"height: expected {surface.shape}, found shape {found.shape}")
        return found
    if surface.height is not None:
        return surface.height
    if int((surface.normal[2] > 0).sum()) < FEWEST:
        return None
    width = surface.pitch_mm if pitch is None else pitch
    return integrate_normals(surface.normal, width or 1.0, level=True, threads=threads)


def _first_scene() -> Scene:
    return Scene([DistantLight(FIRST_LIGHT)])
