"""The page of a painting in the output of a notebook: Jupyter, VS Code, Colab or marimo.

A widget of anywidget (https://anywidget.dev) that runs the script of the page. Tiles are made in
Python when the page asks for them, so a store of any size opens at once; those of a small painting
can be given along, so that a saved notebook still shows it.
"""

from __future__ import annotations

from typing import Any, Unpack

import anywidget
import traitlets

from impasto.errors import ArgumentError, ImpastoError
from impasto.viewer.contents import Contents, ContentsOptions, Shown
from impasto.viewer.scripts import script

LOWEST_PX, HIGHEST_PX = 240, 4000
"""Heights of a widget."""
MOST_EMBEDDED = 32 << 20
"""Bytes of tiles that are written into a notebook, as base64 a third more: browsers open no
notebooks of hundreds of megabytes."""


class PaintingWidget(anywidget.AnyWidget):
    """A painting in any light, in the output of a notebook.

    Parameters
    ----------
    contents
        What is shown.
    height_px
        Height in the notebook, in pixels of the browser.
    embed
        Whether all tiles are given along.

    Attributes
    ----------
    state
        What is shown, as in the link of a page: ``"light=90,45&layer=normals"``. It follows the
        page, and setting it changes what is shown.
    notes
        Web Annotations, a list of dicts, in the same way.
    document, files, height_px
        What the page is given.

    Raises
    ------
    ArgumentError
        A height that no notebook shows, or tiles of more than 32 MiB with ``embed``.
    """

    _esm = script("notebook")
    document = traitlets.Unicode().tag(sync=True)
    files = traitlets.Dict().tag(sync=True)
    state = traitlets.Unicode().tag(sync=True)
    notes: traitlets.List[Any] = traitlets.List().tag(sync=True)
    height_px = traitlets.Int().tag(sync=True)

    def __init__(self, contents: Contents, *, height_px: int = 560, embed: bool = False) -> None:
        if not LOWEST_PX <= height_px <= HIGHEST_PX:
            raise ArgumentError(
                f"height_px: expected {LOWEST_PX} to {HIGHEST_PX}, found {height_px}"
            )
        self._contents = contents
        super().__init__(
            document=contents.text,
            files=_embedded(contents) if embed else {},
            height_px=height_px,
        )
        self.on_msg(self._requested)

    def _requested(self, _: Any, message: Any, buffers: Any) -> None:
        """Answer the page: a file, or why there is none."""
        name = message.get("file") if isinstance(message, dict) else None
        make = self._contents.data(name) if isinstance(name, str) else None
        if make is None:
            self.send({"file": name, "refused": "there is nothing of this name"})
            return
        try:
            data = make()
        except IndexError:
            self.send({"file": name, "refused": "there is nothing of this name"})
        except (ImpastoError, OSError) as error:
            self.send({"file": name, "refused": str(error)})
        else:
            self.send({"file": name}, [data])


def _embedded(contents: Contents) -> dict[str, bytes]:
    """All tiles and photographs, by their names."""
    found: dict[str, bytes] = {}
    size = 0
    for file in contents.names():
        name = file.removesuffix(".js")
        if (make := contents.data(name)) is None:
            continue
        found[name] = make()
        size += len(found[name])
        if size > MOST_EMBEDDED:
            raise ArgumentError(
                f"embed: the tiles of this painting take more than {MOST_EMBEDDED >> 20} MiB, too "
                "much for a notebook; show a detail, or write a page with "
                "impasto.viewer.write_site"
            )
    return found


def view(
    result: Shown,
    *,
    height_px: int = 560,
    embed: bool = False,
    **options: Unpack[ContentsOptions],
) -> PaintingWidget:
    """A widget of a result; see :meth:`impasto.Sbrdf.view`."""
    return PaintingWidget(Contents(result, **options), height_px=height_px, embed=embed)
