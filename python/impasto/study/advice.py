"""Which fit to ask for: what stands at the top of the page, for whoever reads no further."""

from __future__ import annotations

from collections.abc import Sequence

from impasto.study.front import Row
from impasto.study.phrases import between, differences, named, ratio, share

GAINS = (("psnr", 1.0, "dB", 1), ("colour", -1.0, "ΔE00", 2), ("normal", -1.0, "°", 2))
"""What is said of a fit: the error, its sign where more is better, unit and digits."""


def choice(rows: Sequence[Row]) -> str:
    """One line for every reason to leave what comes without asking."""
    of = named(rows)
    draft, standard, reference = (
        of[f"pixels' own, {name}"] for name in ("draft", "standard", "reference")
    )
    nearer, colour, normal = _gains(standard, of["one lobe"])
    return "\n".join(
        (
            '* **Gloss that differs from place to place: `pooling="pixel"`.** Photographs that the '
            f"fit has not seen come out {nearer} nearer, their colours {colour}, normals {normal}. "
            "It wants more lights than one lobe does ([how many](#how-many-photographs)).",
            f'* **A first look: `effort="draft"`, too.** {ratio(draft, standard):.2f} times the '
            f"time of pixels' own lobes; at worst {_most(standard, draft)} are lost, and "
            f"{_flagged(draft)} of the pixels are in doubt instead of {_flagged(standard)}.",
            '* **To know that nothing more is to be had: `effort="reference"`.** '
            f"{ratio(reference, standard):.1f} times the time; at best "
            f"{_most(reference, standard)} are gained.",
        )
    )


def _gains(one: dict[str, Row], other: dict[str, Row]) -> list[str]:
    """By how much the one is nearer, on all data sets."""
    return [
        between([sign * value for value in differences(one, other, what)], unit, digits)
        for what, sign, unit, digits in GAINS
    ]


def _most(one: dict[str, Row], other: dict[str, Row]) -> str:
    """The same on the data set where it is most, or nothing."""
    *most, last = (
        between([max(0.0, *(sign * v for v in differences(one, other, what)))], unit, digits)
        for what, sign, unit, digits in GAINS
    )
    return f"{', '.join(most)} and {last}"


def _flagged(found: dict[str, Row]) -> str:
    return share([row["error"]["flagged"] for row in found.values()])
