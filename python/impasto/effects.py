"""What a plan decides about one effect, and how such decisions are shown."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from impasto.errors import ArgumentError

Decision = Literal["absent", "no-op", "bounded", "folded", "on"]


@dataclass(frozen=True, slots=True)
class PlannedEffect:
    """What a plan does about one effect.

    Attributes
    ----------
    name
        The effect.
    decision
        ``"absent"``: there is nothing to simulate; ``"no-op"``: proven to change no bit;
        ``"bounded"``: left out, proven to change less than the tolerance; ``"folded"``: part of a
        matrix, at no cost; ``"on"``: simulated.
    tiles
        How many tiles of 256 x 256 pixels it is simulated in.
    reason
        Why, with the numbers that decided.
    error
        Most that leaving it out costs a pixel, in the unit of the tolerance.
    saves
        Seconds that are saved because it is not simulated everywhere, as measured; 0 where that
        cannot be told from noise, None if it was not measured.
    """

    name: str
    decision: Decision
    tiles: int
    reason: str
    error: float
    saves: float | None = None


@dataclass(frozen=True, eq=False, repr=False)
class Decisions:
    """What is simulated of a scene, effect by effect.

    Attributes
    ----------
    effects
        One :class:`PlannedEffect` per effect.
    tolerance
        As given.
    error
        The largest sum of what a tile does without, in ``unit``.
    unit
        ``"dE00"``, ``"codes"`` or ``""``.
    tiles
        Number of tiles.
    from_picture
        Whether the exposure follows from the picture, so that nothing is left out by a bound.
    """

    effects: tuple[PlannedEffect, ...]
    tolerance: str | float
    error: float
    unit: str
    tiles: int
    from_picture: bool

    def explain(self) -> str:
        """The decisions as a table."""
        lines = table(self.effects, self.tiles, self.unit)
        total = f"{self.error:.2g} {self.unit}".strip()
        lines.append(f"tolerance {self.tolerance}; left out in any tile: at most {total}")
        if self.tolerance != 0 and self.from_picture:
            lines.append("the exposure follows from the picture: nothing is left out by a bound")
        return "\n".join(lines)

    def to_json(self) -> str:
        """Decisions, numbers and tolerance as JSON, for an archive."""
        effects = records(self.effects)
        numbers = {"tolerance": self.tolerance, "error": self.error, "unit": self.unit}
        return json.dumps({**numbers, "tiles": self.tiles, "effects": effects}, indent=2)

    def _repr_html_(self) -> str:
        """HTML for notebooks: a row for every effect."""
        from impasto.notebook import decisions_view

        return decisions_view(self)

    def __repr__(self) -> str:
        return f"<{type(self).__name__} {names(self.effects)}, tolerance {self.tolerance}>"


def table(effects: Sequence[PlannedEffect], tiles: int, unit: str) -> list[str]:
    """Lines with one row per effect."""
    rows = [("effect", "decision", "why", "error", "saves")]
    for effect in effects:
        share = f" ({effect.tiles}/{tiles} tiles)" if effect.decision == "on" else ""
        error = "0" if effect.error == 0.0 else f"<= {effect.error:.2g} {unit}"
        saves = "-" if effect.saves is None else f"{1e3 * effect.saves:.1f} ms"
        rows.append((effect.name, effect.decision + share, effect.reason, error, saves))
    widths = [max(len(row[column]) for row in rows) for column in range(5)]
    return [
        "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip()
        for row in rows
    ]


def records(effects: Sequence[PlannedEffect]) -> list[dict[str, Any]]:
    """The rows for a JSON file."""
    return [
        {
            "effect": effect.name,
            "decision": effect.decision,
            "tiles": effect.tiles,
            "reason": effect.reason,
            "error": effect.error,
            "saves_seconds": effect.saves,
        }
        for effect in effects
    ]


def names(effects: Sequence[PlannedEffect]) -> str:
    """What is simulated, and what is not though it is there, in a few words."""
    on = [effect.name for effect in effects if effect.decision == "on"]
    off = [effect.name for effect in effects if effect.decision in {"no-op", "bounded"}]
    return ", ".join(on) + (f", without {', '.join(off)}" if off else "")


def checked_tolerance(tolerance: Any) -> tuple[str, float]:
    """What a tolerance counts, ``"code"`` or ``"dE"``, and how much of it; 0 counts nothing.

    Raises
    ------
    ArgumentError
        It is none of ``0``, ``"code:1"`` and ``"dE:0.5"``.
    """
    wrong = ArgumentError(f'tolerance: expected 0, "code:1" or "dE:0.5", found {tolerance!r}')
    if isinstance(tolerance, str):
        kind, _, number = tolerance.partition(":")
        try:
            limit = float(number)
        except ValueError:
            raise wrong from None
        if kind not in {"code", "dE"} or not (np.isfinite(limit) and limit >= 0.0):
            raise wrong
        return kind, limit
    number_like = isinstance(tolerance, int | float) and not isinstance(tolerance, bool)
    if not (number_like and tolerance == 0):
        raise wrong
    return "", 0.0
