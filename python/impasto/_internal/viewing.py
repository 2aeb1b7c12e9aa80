"""``view()`` of results: the viewer is loaded when it is asked for."""

from __future__ import annotations

from importlib import import_module
from typing import Any

from impasto._internal.extras import need


def view(result: Any, options: dict[str, Any]) -> Any:
    """A widget that shows a result.

    The viewer knows results, and no result imports it: what has a ``view`` is told here alone by
    its name.

    Raises
    ------
    MissingExtraError
        Without anywidget.
    """
    need("anywidget", "viewer", "a view in a notebook")
    return import_module("impasto.viewer.widget").view(result, **options)


class Viewable:
    """What notebooks can show in any light."""

    def view(self, **options: Any) -> Any:
        """Show it in a notebook, in any light: drag the lamp over it.

        Parameters
        ----------
        reflectance, stack, shown, title, pitch_mm, height, threads
            As in :func:`impasto.viewer.write_site`.
        height_px
            Height in the notebook, in pixels of the browser; default: 560.
        embed
            Whether all tiles are given along, so that a saved notebook shows the painting without
            Python; default: False, they are made when they are seen.

        Returns
        -------
        PaintingWidget
            For Jupyter, VS Code, Colab or marimo, with the traits ``state`` and ``notes``.

        Raises
        ------
        MissingExtraError
            Without anywidget, which the extra ``viewer`` installs.
        ArgumentError
            What the page cannot show, a height below 240 or above 4000, or tiles of more than
            32 MiB with ``embed``.
        """
        return view(self, options)
