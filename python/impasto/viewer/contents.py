"""What the page shows of one painting: a document, and files by name, made when needed."""

from __future__ import annotations

import base64
import json
import re
from collections.abc import Callable, Iterator, Sequence
from itertools import chain
from typing import Any, Protocol, TypedDict

from numpy.typing import ArrayLike

from impasto._internal.checks import instance, length_mm
from impasto._internal.windows import Window
from impasto.bands import Camera
from impasto.environment import Environment
from impasto.errors import ArgumentError
from impasto.fit.stored import StoredSbrdf
from impasto.io.rti import RelightableImage
from impasto.pictures import STATUS_COLOURS, colour_ramp
from impasto.stack import Stack
from impasto.status import Status
from impasto.surface import Relightable
from impasto.viewer.environments import Environments
from impasto.viewer.layout import SHOWN, UNIT, UNREAD
from impasto.viewer.photographs import Photographs
from impasto.viewer.policy import policy
from impasto.viewer.relightable import RelightablePainting
from impasto.viewer.samples import Photographed, Samples, Windows, checked_size
from impasto.viewer.scales import SIDE, Scale
from impasto.viewer.scripts import page_file, script, style
from impasto.viewer.surfaces import FIRST_LIGHT, painting_in_memory, painting_of_store

FORMAT = 1
"""Version of the document; increased when an entry changes its meaning."""
AGAINST = "against/"
"""Before the names of the tiles of the painting that is shown beside."""
TILE = re.compile(rf"({AGAINST})?tiles/(\d{{1,2}})/(\d{{1,6}})-(\d{{1,6}})")
ENVIRONMENT = re.compile(r"environments/(\d{1,2})")
PHOTOGRAPH = re.compile(r"photographs/(\d{1,4})")
SAMPLES = re.compile(r"samples/(\d{1,7})-(\d{1,7})")


class ContentsOptions(TypedDict, total=False):
    """Options of :class:`Contents`."""

    reflectance: Any
    camera: Any
    stack: Any
    shown: Any
    against: Any
    against_reflectance: Any
    against_title: str
    title: str
    pitch_mm: float | None
    height: ArrayLike | None
    environments: Sequence[Environment]
    samples: bool
    threads: int | None


Shown = Relightable | StoredSbrdf | RelightableImage
"""What the page shows."""


class Painting(Protocol):
    """A painting at all its scales, tile by tile, and what the page must know of it."""

    @property
    def scales(self) -> tuple[Scale, ...]:
        """From the painting itself to the smallest."""

    @property
    def pitch_mm(self) -> float | None:
        """Width of a pixel, if known."""

    @property
    def shown_bands(self) -> int | None:
        """How many bands photographs beside it must have; None: it is shown by spectra."""

    def facts(self) -> dict[str, Any]:
        """Its entries of the document."""

    def effects(self) -> list[dict[str, str]]:
        """What a plan decides about the first picture, and why."""

    def known(self, scale: Scale, part: Window) -> bool:
        """Whether anything is known of a part."""

    def tiles(self, scale: Scale, parts: Sequence[Window]) -> Iterator[bytes]:
        """Parts, near each other, as the page reads them.

        Raises
        ------
        CorruptInputError
            A part of a store is missing or damaged.
        """


class Contents:
    """A painting for the page.

    Parameters
    ----------
    result
        What :func:`impasto.fit_sbrdf` or :func:`impasto.load_sbrdf` returns, an
        :class:`impasto.Surface`, a store of any size as :func:`impasto.open_sbrdf` opens it, or a
        relightable image of another program (:func:`impasto.io.read_relightable`).
    reflectance
        Result of :func:`impasto.fit_reflectance`, for illuminants, adaptation, varnish and spectra;
        default: the spectra of a simulated painting, otherwise none.
    camera
        :class:`impasto.Camera` of the photographs: where there is no reflectance it is estimated;
        of a store, for the tiles that are looked at. Also of ``against``.
    stack
        The photographs, or a source of windows of them (:class:`impasto.jobs.Photographs`). Of
        photographs in the bands of the result the page shows what was measured at a pixel; of a
        result without spectra, in one or three bands, also whole photographs beside the picture.
    shown
        Numbers of the photographs that are shown whole; default: four, evenly among all.
    against
        Another painting of the same size, of any kind that ``result`` may be: the page shows both
        in the same lamp, with a line between them to drag, and their difference.
    against_reflectance
        As ``reflectance``, of the other painting.
    against_title
        What the page calls it.
    title
        Above the page.
    pitch_mm
        Width of a pixel in mm, for the scale bar and near lamps; default: that of the result.
    height
        ``(y, x)`` mm, for the layer of heights and for views from the side; default: that of the
        surface, otherwise the normals, integrated about the plane of the panel. Of a store they
        are those of a small scale.
    environments
        Others than those that impasto contains, to light the painting with; a relightable image
        knows none.
    threads
        None means every allowed core.

    Raises
    ------
    ArgumentError
        Something else, a reflectance for a store, or photographs or another painting of another
        size.
    """

    def __init__(
        self,
        result: Shown,
        *,
        reflectance: Any = None,
        camera: Camera | None = None,
        stack: Any = None,
        shown: Any = None,
        against: Shown | None = None,
        against_reflectance: Any = None,
        against_title: str = "",
        title: str = "",
        pitch_mm: float | None = None,
        height: ArrayLike | None = None,
        environments: Sequence[Environment] = (),
        samples: bool = True,
        threads: int | None = None,
    ) -> None:
        pitch = None if pitch_mm is None else length_mm(pitch_mm, "pitch_mm")
        painting = _painting(result, reflectance, camera, height, pitch, threads)
        other = (
            None
            if against is None
            else _painting(against, against_reflectance, camera, None, pitch, threads)
        )
        self._paintings = [painting] if other is None else [painting, other]
        self._scales = painting.scales if other is None else _common(painting, other)
        rows, columns = self._scales[0].shape
        relightable = isinstance(painting, RelightablePainting)
        self._environments = None if relightable else Environments(environments)
        self._samples = _samples(result, stack, (rows, columns))
        self._photographs = Photographs(
            stack if isinstance(stack, Stack) else None,
            shown,
            painting.shown_bands,
            sampled=self._samples is not None,
        )
        common = {
            "format": FORMAT,
            "width": columns,
            "height": rows,
            "side": SIDE,
            "scales": [
                {"factor": one.factor, "width": one.shape[1], "height": one.shape[0]}
                for one in self._scales
            ],
            "unit": UNIT,
            "shown": SHOWN,
            "unread": UNREAD,
            "pitch": painting.pitch_mm if pitch is None else pitch,
            "light": list(FIRST_LIGHT),
            "environments": [] if self._environments is None else self._environments.records,
            "statuses": _statuses(),
            "ramp": [list(map(int, colour)) for colour in colour_ramp()],
            "photographs": self._photographs.records,
            "samples": samples and self._samples is not None,
        }
        self.document: dict[str, Any] = {"title": title} | common | painting.facts()
        if other is not None:
            self.document["against"] = {"title": against_title} | common | other.facts()

    @property
    def tiles(self) -> int:
        """How many tiles there are, at all scales."""
        count = sum(rows * columns for rows, columns in (one.tiles for one in self._scales))
        return count * len(self._paintings)

    @property
    def lacks(self) -> tuple[str, ...]:
        """Which of ``"width"`` of a pixel and ``"spectra"`` a caller could add."""
        document = self.document
        if "basis" in document:
            return ()
        lacking = document["pitch"] is None, "adaptation" not in document["colours"]
        return tuple(name for name, one in zip(("width", "spectra"), lacking, strict=True) if one)

    @property
    def empty(self) -> bool:
        """Whether no pixel of the painting has an estimate, as far as its smallest scale tells."""
        scale = self._scales[-1]
        rows, columns = scale.tiles
        parts = (scale.window(row, column) for row in range(rows) for column in range(columns))
        return not any(self._paintings[0].known(scale, part) for part in parts)

    def names(self) -> Iterator[str]:
        """The names of all files; those of the page first."""
        return chain.from_iterable(self.together())

    def together(self) -> Iterator[list[str]]:
        """The same, those together that :meth:`files` makes at a time."""
        rooms = 0 if self._environments is None else len(self._environments)
        for name in (
            "index.html", "style.css", "viewer.js", "document.js", "effects.js",
            *(f"environments/{number}.js" for number in range(rooms)),
            *(f"photographs/{number}.js" for number in range(len(self._photographs))),
        ):  # fmt: skip
            yield [name]
        for number, scale in reversed(list(enumerate(self._scales))):
            for folder in ("", AGAINST)[: len(self._paintings)]:
                for block in scale.blocks():
                    yield [f"{folder}tiles/{number}/{row}-{column}.js" for row, column in block]

    def files(self, names: Sequence[str]) -> dict[str, bytes]:
        """What files hold that are of one of :meth:`together`."""
        tiles = [TILE.fullmatch(name.removesuffix(".js")) for name in names]
        if tiles[0] is None:
            made = {name: self.file(name) for name in names}
            return {name: make() for name, make in made.items() if make is not None}
        places = [tuple(map(int, found.groups()[1:])) for found in tiles if found is not None]
        which, scale = int(tiles[0][1] is not None), self._scales[places[0][0]]
        parts = [scale.window(row, column) for _, row, column in places]
        found = zip(names, self._paintings[which].tiles(scale, parts), strict=True)
        return {name: _called(name.removesuffix(".js"), data) for name, data in found}

    def file(self, name: str) -> Callable[[], bytes] | None:
        """What makes the content of a file, which may raise IndexError; None: there is none."""
        pages: dict[str, Callable[[], bytes]] = {
            "index.html": self._index,
            "style.css": lambda: style().encode(),
            "viewer.js": lambda: script().encode(),
            "document.js": self._document,
        }
        if name in pages:
            return pages[name]
        if (data := self.data(name.removesuffix(".js"))) is not None and name.endswith(".js"):
            return lambda: _called(name.removesuffix(".js"), data())
        return None

    def data(self, name: str) -> Callable[[], bytes] | None:
        """The same by its name without ``.js``: of a tile gzip, of a photograph a PNG.

        ``effects`` and ``samples/{row}-{column}`` are JSON.
        """
        if name == "effects":
            return lambda: json.dumps(self._paintings[0].effects()).encode("ascii")
        if found := TILE.fullmatch(name):
            which = int(found[1] is not None)
            number, row, column = map(int, found.groups()[1:])
            return lambda: self._tile(which, number, row, column)
        if (found := ENVIRONMENT.fullmatch(name)) and (rooms := self._environments) is not None:
            chosen = int(found[1])
            return lambda: rooms.data(chosen)
        if (found := SAMPLES.fullmatch(name)) and (samples := self._samples) is not None:
            place = int(found[1]), int(found[2])
            return lambda: samples.data(*place)
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

    def _tile(self, which: int, number: int, row: int, column: int) -> bytes:
        scale, painting = self._scales[number], self._paintings[which]
        return next(iter(painting.tiles(scale, [scale.window(row, column)])))


def _painting(
    result: Any, reflectance: Any, camera: Camera | None, height: ArrayLike | None,
    pitch: float | None, threads: int | None,
) -> Painting:  # fmt: skip
    """What the page shows of any kind of result."""
    if isinstance(result, StoredSbrdf):
        what, words = "store", "is not read beside a store; give the camera"
    elif isinstance(result, RelightableImage):
        what, words = "relightable image", "a relightable image has no spectra"
    else:
        return painting_in_memory(result, reflectance, camera, height, pitch, threads)
    if reflectance is not None:
        raise ArgumentError(f"reflectance: {words}")
    if height is not None:
        raise ArgumentError(f"height: that of a {what} cannot be given")
    if isinstance(result, StoredSbrdf):
        return painting_of_store(result, camera, pitch, threads)
    return RelightablePainting(result)


def _samples(result: Any, stack: Any, shape: tuple[int, int]) -> Samples | None:
    """What was measured at single pixels; None where nothing is known of it.

    Raises
    ------
    ArgumentError
        No photographs, or of another size.
    """
    if stack is None:
        return None
    if not isinstance(stack, Windows):
        instance(stack, Stack, "stack", "an impasto.Stack, a source of windows or None")
    photographed: Photographed = stack
    checked_size(photographed, shape)
    return Samples.of(result, photographed)


def _common(painting: Painting, other: Painting) -> tuple[Scale, ...]:
    """The scales that two paintings of one size have both.

    Raises
    ------
    ArgumentError
        They have different sizes.
    """
    (rows, columns), found = painting.scales[0].shape, other.scales[0].shape
    if found != (rows, columns):
        raise ArgumentError(
            f"against: expected a painting of {columns} x {rows} pixels, as the result has, found "
            f"{found[1]} x {found[0]}; impasto compare brings two states of a painting together"
        )
    both = set(other.scales)
    return tuple(scale for scale in painting.scales if scale in both)


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
