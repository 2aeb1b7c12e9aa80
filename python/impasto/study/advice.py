"""Which fit to ask for: what stands at the top of the page, for whoever reads no further."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import takewhile

from impasto.study.front import Row
from impasto.study.phrases import between, by_data, differences, named, ratio, share, span
from impasto.study.tables import of_knob

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
            "It wants lights enough ([how many](#how-many-photographs)).",
            f'* **A first look: `effort="draft"`, too.** {ratio(draft, standard):.2f} times the '
            f"time of pixels' own lobes; at worst {_most(standard, draft)} are lost, and "
            f"{_doubted(draft, standard)}.",
            '* **To know that nothing more is to be had: `effort="reference"`.** '
            f"{ratio(reference, standard):.1f} times the time; at best "
            f"{_most(reference, standard)} are gained.",
        )
    )


def enough(rows: Sequence[Row]) -> str:
    """With how many lights pixels' own lobes are the better choice."""
    counts = {r["number"] for r in of_knob(rows, "lights") if r["setting"].endswith("one lobe")}
    gains: dict[int, list[list[float]]] = {}
    for count in sorted(counts, reverse=True):
        own, painting = (
            by_data(rows, "lights", f"{count} spread{which}") for which in ("", ", one lobe")
        )
        gains[count] = [differences(own, painting, what) for what in ("psnr", "normal")]
    better = list(takewhile(lambda count: min(gains[count][0]) > 0.0, gains))
    if not gains:
        raise ValueError
    said = "; ".join(
        f"{count} lights {span(nearer, 'dB')}, normals {span(turned, '°', 2)}"
        for count, (nearer, turned) in gains.items()
    )
    verdict = (
        f"With {better[-1]} lights or more, spread evenly, lobes of every pixel's own show "
        "photographs better than one lobe does on every data set"
        if better
        else f"Not even with {max(gains)} lights do lobes of every pixel's own show photographs "
        "better than one lobe on every data set"
    )
    return f"{verdict}. Instead of one lobe through the same photographs: {said}."


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


def _doubted(one: dict[str, Row], other: dict[str, Row]) -> str:
    """How many pixels are flagged beside those of the other."""
    of = [share([row["error"]["flagged"] for row in found.values()]) for found in (one, other)]
    if of[0] == of[1]:
        return f"as many of the pixels are in doubt ({of[0]})"
    return f"{of[0]} of the pixels are in doubt instead of {of[1]}"
