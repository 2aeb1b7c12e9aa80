"""What the page shows of one painting: a document, and files by name, made when needed."""

from __future__ import annotations

import base64
import json
import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, TypedDict

import numpy as np
from numpy.typing import ArrayLike, NDArray

from impasto._internal.checks import length_mm
from impasto._internal.waiting import floats
from impasto.environment import Environment
from impasto.errors import ArgumentError
from impasto.fit.stored import StoredSbrdf
from impasto.height import integrate_normals
from impasto.lighting import metallic, prepare
from impasto.overview import visible
from impasto.pictures import STATUS_COLOURS, colour_ramp
from impasto.plan import plan
from impasto.rig import DistantLight
from impasto.scene import Scene
from impasto.status import Status
from impasto.surface import Relightable, Surface
from impasto.viewer.colours import colours_of
from impasto.viewer.environments import Environments
from impasto.viewer.layout import QUALITY, SHOWN, UNIT, UNREAD, Layout
from impasto.viewer.photographs import Photographs
from impasto.viewer.policy import policy
from impasto.viewer.scales import SIDE, Scales, ScalesInMemory, ScalesOfStore, eye_of
from impasto.viewer.scripts import page_file, script

FORMAT = 1
"""Version of the document; increased when an entry changes its meaning."""
FIRST_LIGHT = (0.0, 0.5**0.5, 0.5**0.5)
"""Direction of the lamp when the page opens: from above, as the pictures of ``impasto render``."""
FEWEST = 100
"""Normals of which heights are made: a plane through fewer is none."""
TILE = re.compile(r"tiles/(\d{1,2})/(\d{1,6})-(\d{1,6})")
ENVIRONMENT = re.compile(r"environments/(\d{1,2})")
PHOTOGRAPH = re.compile(r"photographs/(\d{1,4})")


class ContentsOptions(TypedDict, total=False):
    """Options of :class:`Contents`."""

    reflectance: Any
    stack: Any
    shown: Any
    title: str
    pitch_mm: float | None
    height: ArrayLike | None
    environments: Sequence[Environment]
    threads: int | None


class Contents:
    """A painting for the page.

    Parameters
    ----------
    result
        What :func:`impasto.fit_sbrdf` or :func:`impasto.load_sbrdf` returns, an
        :class:`impasto.Surface`, or a store of any size as :func:`impasto.open_sbrdf` opens it.
    reflectance
        Result of :func:`impasto.fit_reflectance`, for illuminants, adaptation, varnish and spectra;
        default: the spectra of a simulated painting, otherwise none.
    stack
        Photographs to compare with, of a result without spectra in one or three bands.
    shown
        Numbers of the photographs; default: four, evenly among all.
    title
        Above the page.
    pitch_mm
        Width of a pixel in mm, for the scale bar and near lamps; default: that of the result.
    height
        ``(y, x)`` mm, for the layer of heights and for views from the side; default: that of the
        surface, otherwise the normals, integrated about the plane of the panel. A store has none.
    environments
        Others than those that impasto contains, to light the painting with.
    threads
        None means every allowed core.

    Raises
    ------
    ArgumentError
        Something else, a reflectance for a store, or photographs of another size.
    """

    def __init__(
        self,
        result: Relightable | StoredSbrdf,
        *,
        reflectance: Any = None,
        stack: Any = None,
        shown: Any = None,
        title: str = "",
        pitch_mm: float | None = None,
        height: ArrayLike | None = None,
        environments: Sequence[Environment] = (),
        threads: int | None = None,
    ) -> None:
        pitch = None if pitch_mm is None else length_mm(pitch_mm, "pitch_mm")
        if isinstance(result, StoredSbrdf):
            if reflectance is not None:
                raise ArgumentError("reflectance: a store has no spectra; load the result instead")
            if height is not None:
                raise ArgumentError("height: a store is shown without; load the result instead")
            painting = _of_store(result, threads)
        else:
            painting = _in_memory(result, reflectance, height, pitch, threads)
        self._scales = painting.scales
        template = self._scales.template
        self._layout = Layout.of(template, beneath=painting.beneath, quality=painting.quality)
        bands, spectra = len(template.diffuse), painting.reflectance
        rows, columns = self._scales.scales[0].shape
        self._environments = Environments(environments)
        self._photographs = Photographs(
            stack, shown, (rows, columns), bands if spectra is None else None
        )
        self.document: dict[str, Any] = {
            "format": FORMAT,
            "title": title,
            "width": columns,
            "height": rows,
            "side": SIDE,
            "scales": [
                {"factor": one.factor, "width": one.shape[1], "height": one.shape[0]}
                for one in self._scales.scales
            ],
            "groups": self._layout.record(),
            "unit": UNIT,
            "shown": SHOWN,
            "unread": UNREAD,
            "model": template.model,
            "lobes": [{"tinted": np.ndim(lobe.strength) == 3} for lobe in template.lobes],
            "index": float(template.index),
            "coated": bool(template.coated),
            "ambient": template.ambient is not None,
            "beneath": painting.beneath,
            "quality": list(painting.quality),
            "relief": template.height is not None,
            "coefficients": bands,
            "bands": painting.bands,
            "pitch": painting.pitch_mm if pitch is None else pitch,
            "origin": painting.origin,
            "eye": eye_of(painting.eye),
            "light": list(FIRST_LIGHT),
            "colours": colours_of(spectra, bands),
            "environments": self._environments.records,
            "statuses": _statuses(),
            "ramp": [list(map(int, colour)) for colour in colour_ramp()],
            "effects": painting.effects,
            "photographs": self._photographs.records,
        }

    @property
    def tiles(self) -> int:
        """How many tiles there are, at all scales."""
        return sum(rows * columns for rows, columns in (s.tiles for s in self._scales.scales))

    def names(self) -> Iterator[str]:
        """The names of all files; those of the page first."""
        yield from ("index.html", "style.css", "viewer.js", "document.js")
        yield from (f"environments/{number}.js" for number in range(len(self._environments)))
        yield from (f"photographs/{number}.js" for number in range(len(self._photographs)))
        for number, scale in reversed(list(enumerate(self._scales.scales))):
            rows, columns = scale.tiles
            for row in range(rows):
                yield from (f"tiles/{number}/{row}-{column}.js" for column in range(columns))

    def file(self, name: str) -> Callable[[], bytes] | None:
        """What makes the content of a file, which may raise IndexError; None: there is none."""
        pages: dict[str, Callable[[], bytes]] = {
            "index.html": self._index,
            "style.css": lambda: page_file("style.css").encode(),
            "viewer.js": lambda: script().encode(),
            "document.js": self._document,
        }
        if name in pages:
            return pages[name]
        if (data := self.data(name.removesuffix(".js"))) is not None and name.endswith(".js"):
            return lambda: _called(name.removesuffix(".js"), data())
        return None

    def data(self, name: str) -> Callable[[], bytes] | None:
        """The same of a tile or a photograph, by its name without ``.js``: gzip, or a PNG."""
        if found := TILE.fullmatch(name):
            number, row, column = map(int, found.groups())
            return lambda: self._tile(number, row, column)
        if found := ENVIRONMENT.fullmatch(name):
            chosen = int(found[1])
            return lambda: self._environments.data(chosen)
        if found := PHOTOGRAPH.fullmatch(name):
            number = int(found[1])
            return lambda: self._photographs.png(number)
        return None

    @property
    def text(self) -> str:
        """The document as JSON, in ASCII: no character ends a line or a script."""
        return json.dumps(self.document, allow_nan=False, separators=(",", ":"))

    def _index(self) -> bytes:
        return page_file("index.html").replace("POLICY", policy(embedded=True)).encode()

    def _document(self) -> bytes:
        return f"window.impasto = {{ document: {self.text} }};\n".encode("ascii")

    def _tile(self, number: int, row: int, column: int) -> bytes:
        scale = self._scales.scales[number]
        part = self._scales.part(scale, scale.window(row, column))
        return self._layout.tile(part.surface, part.status, part.beneath, part.quality)


@dataclass(frozen=True)
class _Painting:
    """What the document says of a painting, wherever its maps are."""

    scales: Scales
    effects: list[dict[str, str]]
    eye: Any
    pitch_mm: float | None
    origin: list[float]
    bands: list[str]
    reflectance: Any = None
    beneath: bool = False
    quality: tuple[str, ...] = ()


def _of_store(stored: StoredSbrdf, threads: int | None) -> _Painting:
    count = len(stored.bands)
    chosen = None if count in {1, 3} else [count - 1, count // 2, 0]
    # Jobs keep the statistics that a plan needs; of another store every map would be read.
    planned: Any = None
    if stored.statistics() is not None and chosen is None:
        planned = stored.plan(_first_scene(), threads=threads)
    return _Painting(
        scales=ScalesOfStore(stored, chosen),
        effects=[] if planned is None else _effects(planned.effects),
        eye=stored[:1, :1].eye(),
        pitch_mm=stored.pitch_mm,
        origin=[float(value) for value in stored.rig.origin],
        bands=[stored.bands[band] for band in (range(count) if chosen is None else chosen)],
    )


def _in_memory(
    result: Relightable,
    reflectance: Any,
    height: ArrayLike | None,
    pitch: float | None,
    threads: int | None,
) -> _Painting:
    spectra = result.spectra() if reflectance is None else reflectance
    lit: Any = visible(result, spectra)
    scene = _first_scene()
    surface = prepare(lit, scene, reflectance=spectra, threads=threads).surface
    surface = replace(surface, height=_relief(surface, height, pitch, threads))
    planned = plan(lit, scene, reflectance=spectra, fidelity="model", threads=threads)
    beneath: Any = None
    if spectra is not None:
        share = metallic(lit.surface())
        beneath = share if np.ndim(share) else np.full(surface.shape, share, np.float32)
        beneath = beneath if (beneath > 0.0).any() else None
    quality = {name: getattr(result, name) for name in QUALITY if hasattr(result, name)}
    return _Painting(
        scales=ScalesInMemory(surface, getattr(result, "status", None), beneath, quality),
        effects=_effects(planned.effects),
        eye=lit.eye(),
        pitch_mm=surface.pitch_mm,
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


def _effects(effects: Any) -> list[dict[str, str]]:
    return [{"name": one.name, "decision": one.decision, "reason": one.reason} for one in effects]


def _statuses() -> dict[int, Any]:
    return {
        int(one): {
            "name": one.name.lower().replace("_", " "),
            "reason": one.reason,
            "colour": list(STATUS_COLOURS[one]),
        }
        for one in Status
    }


def _called(name: str, data: bytes) -> bytes:
    """A script that hands data to the page: a page from a disk can read no file but by a script."""
    text = base64.b64encode(data).decode("ascii")
    return f'window.impasto.arrived("{name}", "{text}");\n'.encode("ascii")
