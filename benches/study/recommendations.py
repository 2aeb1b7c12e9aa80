"""Recommendations at the top of the page: which fit to choose."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import takewhile

import numpy as np

from study.candidates import Row
from study.formatting import between, by_data, differences, named, ratio, span
from study.tables import of_knob

GAINS = (("psnr", 1.0, "dB", 1), ("colour", -1.0, "ΔE00", 2), ("normal", -1.0, "°", 2))
"""Errors that are named: key, sign (1: more is better), unit, digits."""


def choice(rows: Sequence[Row]) -> str:
    """One line per wish: the arguments, what they gain and cost."""
    of = named(rows)
    draft, standard, reference = (
        of[f"lobes per pixel, {name}"] for name in ("draft", "standard", "reference")
    )
    painting, papers = of["one lobe"], of["one lobe, as the papers have it"]
    nearer, colour, normal = _gains(standard, painting)
    shown = span(differences(papers, painting, "psnr"), "dB")
    return "\n".join(
        (
            '* **Gloss that varies over the painting: `pooling="pixel"`.** Held-out photographs '
            f"are {nearer} nearer than with one lobe, colours {colour}, normals {normal}. It needs "
            "[enough lights](#how-many-photographs).",
            '* **A first look: `pooling="pixel", effort="draft"`.** '
            f"{ratio(draft, standard):.2f} times the time of the standard effort; at most "
            f"{_most(standard, draft)} are lost, and {_doubted(draft, standard)}.",
            '* **Three rounds instead of two: `pooling="pixel", effort="reference"`.** '
            f"{ratio(reference, standard):.1f} times the time; at most "
            f"{_most(reference, standard)} are gained.",
            '* **One strength and one width for the painting: `pooling="painting"`.** It needs the '
            "fewest lights. Without the joint fit (`joint=False`, as in the papers) it takes "
            f"{ratio(papers, painting):.2f} times the time and changes photographs by {shown}.",
        )
    )


def enough(rows: Sequence[Row]) -> str:
    """The number of lights from which lobes per pixel are the better choice."""
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
        f"{count} lights {span(nearer, 'dB')}, normals {span(angle, '°', 2)}"
        for count, (nearer, angle) in gains.items()
    )
    verdict = (
        f"With {better[-1]} lights or more, spread evenly, lobes per pixel predict held-out "
        "photographs better than one lobe on every data set"
        if better
        else f"Even with {max(gains)} lights, lobes per pixel do not predict held-out photographs "
        "better than one lobe on every data set"
    )
    return f"{verdict}. Difference to one lobe: {said}."


def _gains(one: dict[str, Row], other: dict[str, Row]) -> list[str]:
    """Gains of one fit over another, over the data sets."""
    return [
        between([sign * value for value in differences(one, other, what)], unit, digits)
        for what, sign, unit, digits in GAINS
    ]


def _most(one: dict[str, Row], other: dict[str, Row]) -> str:
    """The largest gain over the data sets, at least zero."""
    *most, last = (
        between([max([0.0, *(sign * value for value in known)])], unit, digits)
        for what, sign, unit, digits in GAINS
        if (known := differences(one, other, what))
    )
    return f"{', '.join(most)} and {last}"


def _doubted(one: dict[str, Row], other: dict[str, Row]) -> str:
    """Shares of flagged pixels of two fits, in the mean of the data sets."""
    few, many = (
        f"{100.0 * np.mean([row['error']['flagged'] for row in found.values()]):.1f} %"
        for found in (one, other)
    )
    if few == many:
        return f"as many pixels are flagged ({few})"
    return f"{few} of the pixels are flagged instead of {many}"
