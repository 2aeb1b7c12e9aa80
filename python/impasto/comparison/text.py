"""A comparison in words: the table on the command line and in notebooks."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from impasto.comparison.entries import (
    Area,
    Cluster,
    ClusterExtent,
    GlossChange,
    Quantity,
    Registration,
)

SHOWN = 8
"""Areas that are listed."""
ROUNDING = 1e-5
"""What is smaller comes from rounding, since maps are float32: 1e-7 of a radian is 6e-6 degrees."""
TITLES = {"normal": "normal, degrees", "colour": "colour, dE00", "gloss": "gloss, ratio of beta"}
REASONS = {
    "tested": "tested", "no_error": "without a predicted error", "outside": "outside of the second",
    "unknown_before": "unknown before", "unknown_after": "unknown after",
    "unknown_both": "unknown in both",
}  # fmt: skip


def as_text(
    names: tuple[str, str],
    place: Registration,
    quantities: Sequence[Quantity],
    gloss: GlossChange,
    compared: Mapping[str, int],
    areas: Sequence[Area],
    extent: ClusterExtent,
    clusters: Sequence[Cluster],
    *,
    alpha: float,
    illuminant: str,
    fits: tuple[str, str],
) -> str:
    """Everything, in lines."""
    lines = [f"{names[0]} -> {names[1]}", ""]
    lines += [_placed(place), f"colours {illuminant}"]
    lines += ["pixels: " + statuses(compared)]
    if other := fits_in_words(fits):
        lines.append("caution: " + other)
    lines.append("")
    lines.append(f"{'':22}{'median':>9}{'95 %':>9}{'least':>9}{'changed':>10}")
    for one in quantities:
        lines.append(
            f"{TITLES[one.name]:22}{_number(one.median):>9}{_number(one.high):>9}"
            f"{_number(one.detectable):>9}{_share(one):>10}"
        )
    lines.append(
        f"least: the smallest significant difference; {100 * alpha:g} % of unchanged pixels are "
        "marked by chance"
    )
    if not all(one.tested for one in quantities if one.name == "gloss"):
        lines.append("gloss is tested where both fits have lobes of pixels or segments")
    lines += ["", _gloss(gloss), "", clusters_in_words(extent)]
    if clusters:
        lines.append(f"{'place':>12}{'pixels':>9}{'mm2':>9}{'degrees':>9}{'dE00':>8}{'beta':>8}"
                     f"{'normal':>9}{'colour':>9}{'gloss':>9}")  # fmt: skip
        for own in clusters[:SHOWN]:
            lines.append(
                f"{f'{own.left}, {own.top}':>12}{own.pixels:>9}{_number(own.area_mm2):>9}"
                f"{_number(own.normal):>9}{_number(own.colour):>8}{_number(own.gloss):>8}"
                f"{_shares(own.changed)}"
            )
        lines += _more(extent.found)
        lines.append("place: left, top in pixels before; means over the pixels of the area")
    if areas:
        lines += ["", f"{'area':8}{'pixels':>10}{'degrees':>9}{'dE00':>8}{'beta':>8}"
                  f"{'normal':>9}{'colour':>9}{'gloss':>9}"]  # fmt: skip
        for area in areas[:SHOWN]:
            lines.append(
                f"{area.name:8}{area.pixels:>10}{_number(area.normal):>9}"
                f"{_number(area.colour):>8}{_number(area.gloss):>8}{_shares(area.changed)}"
            )
        lines += _more(len(areas))
    return "\n".join(lines)


def fits_in_words(fits: tuple[str, str]) -> str:
    """That two fits are not alike; empty where they are, or where it is not known."""
    if fits[0] == fits[1]:
        return ""
    return (
        f"fitted in two ways, {fits[0]} before and {fits[1]} after: what the fits alone change is "
        "marked, too; fit both with the same pooling"
    )


def clusters_in_words(extent: ClusterExtent) -> str:
    """How many changed areas there are, and from which size on they count."""
    if not math.isfinite(extent.critical):
        return "changed areas: not told from chance, since too many pixels are marked"
    return (
        f"changed areas of {extent.critical:g} pixels or more: {extent.found or 'none'}, "
        f"{100 * extent.share:.2f} % of the painting; by chance, in {100 * extent.familywise:g} % "
        "of unchanged paintings one"
    )


def table_rows(
    quantities: Sequence[Quantity],
    compared: Mapping[str, int],
    alpha: float,
    extent: ClusterExtent,
    fits: tuple[str, str],
) -> dict[str, object]:
    """The same in short, for a notebook."""
    rows: dict[str, object] = {
        TITLES[one.name]: f"median {_number(one.median)}, 95 % {_number(one.high)}, "
        f"changed: {_share(one)}"
        for one in quantities
    }
    rows["changed areas"] = clusters_in_words(extent).removeprefix("changed areas ")
    rows["pixels"] = statuses(compared)
    rows["marked by chance"] = f"{100 * alpha:g} %"
    if other := fits_in_words(fits):
        rows["caution"] = other
    return rows


def statuses(compared: Mapping[str, int]) -> str:
    """``98.1 % tested, 1.9 % unknown after``."""
    total = max(sum(compared.values()), 1)
    return ", ".join(
        f"{100 * compared[name] / total:.1f} % {words}"
        for name, words in REASONS.items()
        if name in compared
    )


def _placed(place: Registration) -> str:
    if place.sigma == 0.0 and place.linear == ((1.0, 0.0), (0.0, 1.0)):
        return f"pixel for pixel; tilt {math.degrees(place.tilt):.2f}°"
    return (
        f"shifted by {place.offset[0]:.2f}, {place.offset[1]:.2f} pixels, scaled by "
        f"{place.scale:.5f}, rotated by {math.degrees(place.angle):.3f}°"
        f"{', sheared' * place.affine}, ± {place.sigma:.3f} pixels; "
        f"tilt {math.degrees(place.tilt):.2f}°"
    )


def _gloss(gloss: GlossChange) -> str:
    def pair(values: tuple[float, float], factor: float, unit: str) -> str:
        return " -> ".join(f"{factor * value:.3g}{unit}" for value in values)

    def deviations(z: float) -> str:
        return f" ({z:+.1f} standard deviations)" if math.isfinite(z) else ""

    return (
        f"gloss of the painting: beta {pair(gloss.beta, 1.0, '')}{deviations(gloss.beta_z)}, "
        f"gamma {pair(gloss.gamma, 180.0 / math.pi, '°')}{deviations(gloss.gamma_z)}"
    )


def _share(one: Quantity) -> str:
    return f"{100 * one.significant:.2f} %" if one.tested else "untested"


def _shares(changed: tuple[float, float, float]) -> str:
    return "".join(f"{100 * share:>7.1f} %" for share in changed)


def _more(count: int) -> list[str]:
    return [f"... and {count - SHOWN} more"] if count > SHOWN else []


def _number(value: float) -> str:
    if not math.isfinite(value):
        return "-"
    return f"{value:.3g}" if abs(value) >= ROUNDING else "0"
