"""A folder that shows a painting in any browser: from a web server, or from a disk without one."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Generator, Sequence
from concurrent.futures import Future
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from numpy.typing import ArrayLike

from impasto._internal.calls import ProgressCallback, reporting, thread_count
from impasto._internal.pools import Pool
from impasto._internal.printable import printable
from impasto.bands import Camera
from impasto.environment import Environment
from impasto.errors import ArgumentError
from impasto.io.files import atomic_together
from impasto.io.folders import new_folder
from impasto.viewer.contents import AGAINST, Contents, Shown

MARK = b"window.impasto = "
"""How the document of a site begins."""
OWN = {"index.html", "style.css", "viewer.js", "document.js", "effects.js"}
OWN |= {"tiles", "photographs", "environments", AGAINST.rstrip("/")}
"""What lies in the folder of a site."""
TOGETHER = 32
"""Files that reach the disk at a time, or more."""
MOST_AT_ONCE = 4
"""Most threads: each holds the maps and the tiles of 1024 x 1024 pixels, some 100 MB."""


@dataclass(frozen=True)
class Site:
    """A folder that was written.

    Attributes
    ----------
    path
        The folder; ``index.html`` in it is the page.
    files
        How many files it holds.
    size
        Bytes of all files.
    script
        Bytes of the script and the style of the page.
    lacks
        Which of ``"width"`` of a pixel and ``"spectra"`` the page does not have.
    """

    path: Path
    files: int
    size: int
    script: int
    lacks: tuple[str, ...] = ()


def write_site(
    result: Shown,
    out: str | os.PathLike[str],
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
    threads: int | None = None,
    progress: bool | ProgressCallback = False,
) -> Site:
    """Write a folder that shows a painting in a browser, in any light.

    The folder works on any web server, and without one: ``index.html`` can be opened from a disk or
    a stick. Nothing is loaded from another host. An older site of that name is replaced when the
    new one is whole.

    Parameters
    ----------
    result
        What :func:`impasto.fit_sbrdf` or :func:`impasto.load_sbrdf` returns, an
        :class:`impasto.Surface`, a store of any size as :func:`impasto.open_sbrdf` opens it, or a
        relightable image of another program (:func:`impasto.io.read_relightable`).
    out
        The folder to write.
    reflectance
        Result of :func:`impasto.fit_reflectance`, for illuminants, adaptation, varnish and spectra;
        default: the spectra of a simulated painting, otherwise none.
    camera
        :class:`impasto.Camera` of the photographs: where there is no reflectance it is estimated.
        Also of ``against``.
    stack
        Photographs to compare with, of a result without spectra in one or three bands.
    shown
        Numbers of the photographs; default: four, evenly among all.
    against, against_reflectance
        Another painting of the same size, of any kind that ``result`` may be, and its spectra: the
        page shows both in the same lamp, with a line between them, and their difference.
    against_title
        What the page calls it.
    title
        Above the page; default: none.
    pitch_mm
        Width of a pixel in mm, for the scale bar and near lamps; default: that of the result.
    height
        ``(y, x)`` mm, for the layer of heights and for views from the side; default: that of the
        surface, otherwise the normals, integrated about the plane of the panel. Of a store they
        are those of a small scale.
    environments
        Others than those that impasto contains, to light the painting with.
    threads, progress
        None means every allowed core; a bool or a callable ``(done, total)`` in files.

    Returns
    -------
    Site
        Where it is and what it holds.

    Raises
    ------
    ArgumentError
        A folder with anything but an older site; what the page cannot show.
    CorruptInputError
        A part of a store is missing or damaged; no site is written.
    """
    target = Path(out)
    _check(target)
    contents = Contents(
        result,
        reflectance=reflectance,
        camera=camera,
        stack=stack,
        shown=shown,
        against=against,
        against_reflectance=against_reflectance,
        against_title=against_title,
        title=title,
        pitch_mm=pitch_mm,
        height=height,
        environments=environments,
        samples=False,
        threads=threads,
    )
    total = sum(map(len, contents.together()))
    target.parent.mkdir(parents=True, exist_ok=True)
    size = done = page = 0
    with (
        reporting(progress, "writing the site") as callback,
        new_folder(target) as made,
        closing(_made(contents, min(thread_count(threads), MOST_AT_ONCE))) as together,
    ):
        for files in together:
            atomic_together({made / name: data for name, data in files.items()})
            size += sum(map(len, files.values()))
            page += sum(len(files.get(name, b"")) for name in ("viewer.js", "style.css"))
            done += len(files)
            if callback is not None:
                callback(done, total)
    return Site(target, done, size, page, contents.lacks)


def _made(contents: Contents, threads: int) -> Generator[dict[str, bytes], None, None]:
    """All files, as many at a time as reach the disk together, or as are made together.

    One block more than there are threads is under way or waits to be written.
    """
    waiting: deque[Future[dict[str, bytes]]] = deque()
    ready: dict[str, bytes] = {}
    with Pool(threads) as pool:
        try:
            for names in contents.together():
                waiting.append(pool.submit(contents.files, names))
                while len(waiting) > threads:
                    ready |= waiting.popleft().result()
                if len(ready) >= TOGETHER:
                    yield ready
                    ready = {}
            while waiting:
                ready |= waiting.popleft().result()
            yield ready
        finally:
            pool.shutdown(cancel_futures=True)


def _check(target: Path) -> None:
    """Refuse a name that holds anything but an older site."""
    if target.is_symlink() or (target.exists() and not target.is_dir()):
        raise ArgumentError(f"out: {target} is a file or a link; give the name of a new folder")
    entries = list(target.iterdir()) if target.is_dir() else []
    if linked := sorted(one.name for one in entries if one.is_symlink()):
        raise ArgumentError(
            f"out: {printable(linked[0])} in {target} is a link, which no site of impasto has; "
            "give another name"
        )
    inside = {one.name for one in entries}
    if not inside:
        return
    own = False
    if (target / "document.js").is_file():
        with (target / "document.js").open("rb") as document:
            own = document.read(len(MARK)) == MARK
    if foreign := sorted(inside if not own else inside - OWN):
        raise ArgumentError(
            f"out: {target} holds {printable(foreign[0])}, which is no part of a site of impasto; "
            "give another name"
        )
