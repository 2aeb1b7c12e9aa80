"""What the page shows of one painting: a document and files by name, each made when it is needed."""

from __future__ import annotations

import base64
import json
import re
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from impasto._internal.checks import length_mm
from impasto.errors import ArgumentError
from impasto.fit.stored import StoredSbrdf
from impasto.lighting import metallic, prepare
from impasto.overview import visible
from impasto.pictures import STATUS_COLOURS, colour_ramp
from impasto.plan import plan
from impasto.rig import DistantLight
from impasto.scene import Scene
from impasto.status import Status
from impasto.surface import Relightable
from impasto.viewer.colours import colours_of
from impasto.viewer.layout import SHOWN, UNIT, UNREAD, Layout
from impasto.viewer.photographs import Photographs
from impasto.viewer.policy import policy
from impasto.viewer.scales import SIDE, Scales, ScalesInMemory, ScalesOfStore, eye_of
from impasto.viewer.script import page_file, script

FORMAT = 1
"""Version of the document; increased when an entry changes its meaning."""
FIRST_LIGHT = (0.0, 0.5**0.5, 0.5**0.5)
"""Direction of the lamp when the page opens: from above, as the pictures of ``impasto render``."""
TILE = re.compile(r"tiles/(\d{1,2})/(\d{1,6})-(\d{1,6})\.js")
PHOTOGRAPH = re.compile(r"photographs/(\d{1,4})\.js")


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
        threads: int | None = None,
    ) -> None:
        pitch = None if pitch_mm is None else length_mm(pitch_mm, "pitch_mm")
        self._scales: Scales
        self._has_beneath = False
        scene = Scene([DistantLight(FIRST_LIGHT)])
        if isinstance(result, StoredSbrdf):
            if reflectance is not None:
                raise ArgumentError("reflectance: a store has no spectra; load the result instead")
            count = len(result.bands)
            bands = None if count in {1, 3} else [count - 1, count // 2, 0]
            self._scales = ScalesOfStore(result, bands)
            known = result.statistics() is not None
            planned: Any = result.plan(scene, bands=bands, threads=threads) if known else None
            eye = result[:1, :1].eye()
            pitch = result.pitch_mm if pitch is None else pitch
            names = list(result.bands if bands is None else np.take(result.bands, bands))
        else:
            spectra = result.spectra() if reflectance is None else reflectance
            lit: Any = visible(result, spectra) if hasattr(result, "with_bands") else result
            prepared = prepare(lit, scene, reflectance=spectra, threads=threads)
            surface = prepared.surface
            beneath: Any
            planned = plan(lit, scene, reflectance=spectra, fidelity="model", threads=threads)
            status = getattr(result, "status", None)
            beneath = None if spectra is None else metallic(lit.surface())
            if beneath is not None and np.ndim(beneath) == 0:
                share = np.float32(beneath)
                beneath = np.full(surface.shape, share) if share > 0.0 else None
            self._has_beneath = beneath is not None
            self._scales = ScalesInMemory(surface, status, beneath)
            eye, reflectance = lit.eye(), spectra
            pitch = surface.pitch_mm if pitch is None else pitch
            names = list(getattr(lit, "bands", ()))
        template = self._scales.template
        self._layout = Layout.of(template, beneath=self._has_beneath)
        whole = self._scales.scales[0].shape
        self._photographs = Photographs(
            stack, shown, whole, None if reflectance is not None else len(template.diffuse)
        )
        bands_of = len(template.diffuse)
        self.document: dict[str, Any] = {
            "format": FORMAT,
            "title": title,
            "width": whole[1],
            "height": whole[0],
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
            "beneath": self._has_beneath,
            "relief": template.height is not None,
            "coefficients": bands_of,
            "bands": [str(name) for name in names],
            "pitch": pitch,
            "origin": [float(value) for value in template.origin]
            if not isinstance(result, StoredSbrdf)
            else [float(value) for value in result.rig.origin],
            "eye": eye_of(eye),
            "light": list(FIRST_LIGHT),
            "colours": colours_of(reflectance, bands_of),
            "statuses": {
                int(one): {
                    "name": one.name.lower().replace("_", " "),
                    "reason": one.reason,
                    "colour": list(STATUS_COLOURS[one]),
                }
                for one in Status
            },
            "ramp": [list(map(int, colour)) for colour in colour_ramp()],
            "effects": []
            if planned is None
            else [
                {"name": one.name, "decision": one.decision, "reason": one.reason}
                for one in planned.effects
            ],
            "photographs": self._photographs.records,
        }

    @property
    def tiles(self) -> int:
        """How many tiles there are, at all scales."""
        return sum(rows * columns for rows, columns in (s.tiles for s in self._scales.scales))

    def names(self) -> Iterator[str]:
        """The names of all files; those of the page first."""
        yield from ("index.html", "style.css", "viewer.js", "document.js")
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
        if found := TILE.fullmatch(name):
            number, row, column = map(int, found.groups())
            return lambda: self._tile(number, row, column)
        if found := PHOTOGRAPH.fullmatch(name):
            number = int(found[1])
            return lambda: _called(f"photographs/{number}", self._photographs.png(number))
        return None

    def _index(self) -> bytes:
        return page_file("index.html").replace("POLICY", policy(embedded=True)).encode()

    def _document(self) -> bytes:
        # ASCII alone: no character ends a line or a script.
        text = json.dumps(self.document, allow_nan=False, separators=(",", ":"))
        return f"window.impasto = {{ document: {text} }};\n".encode("ascii")

    def _tile(self, number: int, row: int, column: int) -> bytes:
        scale = self._scales.scales[number]
        part = self._scales.part(scale, scale.window(row, column))
        tile = self._layout.tile(part.surface, part.status, part.beneath)
        return _called(f"tiles/{number}/{row}-{column}", tile)


def _called(name: str, data: bytes) -> bytes:
    """A script that hands data to the page: a page from a disk can read no file but by a script."""
    text = base64.b64encode(data).decode("ascii")
    return f'window.impasto.arrived("{name}", "{text}");\n'.encode("ascii")
