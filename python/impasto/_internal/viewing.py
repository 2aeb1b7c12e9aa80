"""``view()`` of results: they say that they can be shown, and not by what.

The viewer imports results, so no result may import it. What shows them is given here once, by the
package itself, which imports both.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from impasto._internal.extras import need

Show = Callable[[Any, dict[str, Any]], Any]
"""Makes a widget of a result with options."""


class _Shows:
    """What shows results; set when the package is imported."""

    by: Show | None = None


def shown_by(show: Show) -> None:
    """From now on :func:`view` shows results by this."""
    _Shows.by = show


def view(result: Any, options: dict[str, Any]) -> Any:
    """A widget that shows a result.

    Raises
    ------
    MissingExtraError
        Without anywidget.
    """
    need("anywidget", "viewer", "a view in a notebook")
    assert _Shows.by is not None, "impasto/__init__.py gives it"
    return _Shows.by(result, options)


class Viewable:
    """What notebooks can show in any light."""

    def view(self, **options: Any) -> Any:
        """Show it in a notebook, in any light: drag the lamp over it.

        Parameters
        ----------
        reflectance, stack, shown, title, pitch_mm, height, environments, threads
            As in :func:`impasto.viewer.write_site`.
        against, against_reflectance, against_title
            As there: another painting beside it, in the same lamp.
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
