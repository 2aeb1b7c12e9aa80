"""What a study's rows say, in sentences: every number on the page comes from the record."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np

from impasto._internal.wording import counted
from impasto.effort import PRESETS, Effort, Origin
from study import wiener_numpy
from study.candidates import Row
from study.excess_cost import PRECISIONS, STEPS
from study.formatting import between, by_data, differences, levels, named, ratio, share, span
from study.presets import checked, grid_name, preset_of
from study.recommendations import choice, enough
from study.repeatability import TENTH, apart
from study.tables import SETS, beaten, compared, of_knob, preset_rows, searched_in, unbeaten
from study.treatments import SELECTIONS

VIEWS = "770 views"
STARTS: tuple[Origin, ...] = ("multistart", "neighbours", "neighbours-only")
"""Where searches start: at fixed widths, at what other pixels found, a second lobe there alone."""
CUT = 39
"""How many times fewer photographs Heuberger speaks of, at least: some forty."""


def paragraphs(rows: Sequence[Row]) -> dict[str, str]:
    """Paragraphs by their names; those that a study has rows for."""
    made = {}
    for sentence in SENTENCES:
        try:
            made[sentence.__name__] = sentence(rows)
        except (KeyError, ValueError, IndexError):
            # A quick study, or one of some knobs, has not measured what the paragraph is about.
            continue
    return made


def promises(rows: Sequence[Row]) -> str:
    """What presets promise, and whether it is so."""
    lines = []
    for check in checked(rows):
        kept = "Kept" if check.kept else "**Not kept**"
        lines.append(f"* `{check.preset}`: {check.promise}. {kept}: {check.found}.")
    return "\n".join(lines)


def photographs(rows: Sequence[Row]) -> str:
    """What lights, and their choice, are worth."""
    every = levels(rows, "lights", "all", "psnr")
    lines = []
    for count in (24, 14, 9):
        losses = {}
        for kind in SELECTIONS:
            some = levels(rows, "lights", f"{count} {kind}", "psnr")
            losses[kind] = float(np.mean([every[data] - some[data] for data in every]))
        lines.append(f"{count} lights " + ", ".join(f"{loss:.1f}" for loss in losses.values()))
    return (
        "Decibels lost against all lights, in the mean of the data sets "
        f"({', '.join(SELECTIONS)}): {'; '.join(lines)}."
    )


def bound(rows: Sequence[Row]) -> str:
    """How near the presets come to what no fit can beat."""
    own = {name: named(rows)[f"lobes per pixel, {name}"]["own model"] for name in PRESETS}
    said = ", ".join(
        f'`"{name}"` {row["error"]["normal"] / row["bound"]:.2f}, {row["width"]:.2f} and '
        f"{row['strength']:.2f}"
        for name, row in own.items()
    )
    return (
        "On the simulated paintings with all photographs, errors of normals (mean), widths and "
        "strengths of gloss (median) are these multiples of their Cramér-Rao bounds: "
        f"{said}. The bound of a strength assumes a colourless varnish; the fit does not."
    )


def views(rows: Sequence[Row]) -> str:
    """Heuberger's claim."""
    found = of_knob(rows, "views")
    (whole,) = (row for row in found if row["setting"] == "all")
    every, total = whole["error"]["psnr"], whole["number"]
    best: dict[int, float] = {}
    for row in found:
        best[row["number"]] = max(best.get(row["number"], -np.inf), row["error"]["psnr"] - every)
    del best[total]
    cut = [gain for count, gain in best.items() if round(total / count) >= CUT]
    verdict = "it can" if max(cut) >= -1.0 else "it cannot"
    rest = ", ".join(
        f"1/{round(total / count)} {span([best[count]], 'dB', 0)}"
        for count in sorted(best, reverse=True)
    )
    return (
        "Heuberger (2005) reports that the 770 views of the third paper's rig can be cut 40 to 100 "
        f"times for about 1 dB. Here {verdict}. Change against all photographs, by the best of the "
        f"three selections: {rest}. The simulated surface follows the fitted model and the "
        f"held-out photographs have no noise, so the loss is counted from {every:.0f} dB; "
        "photographs of a real painting have a noise floor."
    )


def doubt(rows: Sequence[Row]) -> str:
    """What robust weights are worth."""
    both, none = (
        by_data(rows, "robust", setting)
        for setting in ("stereo on, samples on", "stereo off, samples off")
    )
    time = ratio(both, none)
    flagged = [float(np.mean([r["error"]["flagged"] for r in rs.values()])) for rs in (none, both)]
    return (
        f"Robust weights and robust photometric stereo together take {time:.2f} times the time of "
        "neither. They change held-out photographs by "
        f"{span(differences(both, none, 'psnr'), 'dB')} and normals by "
        f"{span(differences(both, none, 'normal'), '°', 3)}; flagged pixels fall "
        f"from {100 * flagged[0]:.0f} % to {100 * flagged[1]:.1f} %."
    )


def steps(rows: Sequence[Row]) -> str:
    """What more steps are worth, of photographs and of normals."""
    rounds = PRESETS["standard"].rounds
    few, many = (
        by_data(rows, "effort", grid_name(effort))
        for effort in (Effort(rounds=rounds, iterations=n, start=STARTS[0]) for n in (2, 10))
    )

    def changed(what: str) -> str:
        pairs = [(few[data]["error"][what], many[data]["error"][what]) for data in few]
        return span([100.0 * (b / a - 1.0) for a, b in pairs if a is not None], "%", 0)

    return (
        f'With {counted(rounds, "round")} and `start="{STARTS[0]}"`, ten steps instead of two '
        f"take {ratio(many, few):.1f} times the time. They change the error of held-out "
        f"photographs by {changed('relative')} and that of normals by {changed('normal')}."
    )


def starts(rows: Sequence[Row]) -> str:
    """Whether it matters where the search starts."""
    found = [row["setting"] for row in of_knob(rows, "starts")]
    others = [name for name in dict.fromkeys(found) if name != "robust"]
    own = levels(rows, "starts", "robust", "psnr")
    angles = levels(rows, "starts", "robust", "normal")
    gains, angles_off = [], []
    for name in others:
        some, more = (levels(rows, "starts", name, what) for what in ("psnr", "normal"))
        gains += [some[data] - own[data] for data in own]
        angles_off += [more[d] - angle for d, angle in angles.items() if angle is not None]
    return (
        f"Starting normals from {len(others)} other methods of photometric stereo change held-out "
        f"photographs by {span(gains, 'dB')} and normals by {span(angles_off, '°', 3)}."
    )


def searches(rows: Sequence[Row]) -> str:
    """What starting from neighbouring pixels saves and costs."""
    found = {
        start: by_data(rows, "effort", grid_name(replace(PRESETS["standard"], start=start)))
        for start in STARTS
    }
    lines = [
        f'`start="{start}"` takes {ratio(found[start], found[other]):.2f} times the time of '
        f'`start="{other}"`. It changes held-out photographs by '
        f"{span(differences(found[start], found[other], 'psnr'), 'dB')} and normals by "
        f"{span(differences(found[start], found[other], 'normal'), '°', 3)}."
        for other, start in pairwise(STARTS)
    ]
    return " ".join(lines)


def precision(rows: Sequence[Row]) -> str:
    """What it is worth to search in double precision."""
    found: dict[str, dict[str, Row]] = {}
    for row in of_knob(rows, "precision"):
        found.setdefault(row["setting"], {})[row["data"]] = row
    lines = [
        f'`precision="{name}"` takes {ratio(found[name], found["single"]):.2f} times the time, '
        f"photographs {span(differences(found[name], found['single'], 'psnr'), 'dB')}, "
        f"normals {span(differences(found[name], found['single'], 'normal'), '°', 3)}"
        for name in ("polished", "double")
    ]
    return f"Against single precision: {'; '.join(lines)}."


def excess(rows: Sequence[Row]) -> str:
    """How far above the least cost a search ends."""
    found: dict[tuple[str, int], list[Row]] = {}
    for row in of_knob(rows, "search"):
        found.setdefault((searched_in(row), row["number"]), []).append(row["excess"])
    few, many = PRESETS["standard"].iterations, STEPS[-1]

    def within(precision: str, steps: int, what: str) -> str:
        shares = [share[what] for share in found[precision, steps]]
        return " to ".join(dict.fromkeys(f"{end(shares):.0e}" for end in (min, max)))

    def bad(steps: int) -> str:
        every = [100.0 * share["bad"] for name in PRECISIONS for share in found[name, steps]]
        return between(every, "%", 1)

    def both(steps: int, what: str) -> str:
        return " and ".join(within(name, steps, what) for name in PRECISIONS)

    single, double = (within(name, few, "p99") for name in PRECISIONS)
    return (
        f'A search of {few} steps (`"standard"`) ends {single} above the least cost in single '
        f"precision (99th percentile) and {double} in double; {bad(few)} of the pixels end more "
        f"than a hundredth above it. With {many} steps these are {both(many, 'p99')}, and "
        f"{bad(many)}; the medians are {both(many, 'median')}."
    )


def lobes(rows: Sequence[Row]) -> str:
    """What a further lobe is worth."""
    names = ("none", *(f"{n} at most" for n in (1, 2, 3)))
    at_most = [by_data(rows, "lobes", name) for name in names]
    lines = [
        f"{n} at most instead of {n - 1}: {ratio(at_most[n], at_most[n - 1]):.1f} times the time, "
        f"{span(differences(at_most[n], at_most[n - 1], 'psnr'), 'dB')}"
        for n in (2, 3)
    ]
    first = differences(at_most[1], at_most[0], "psnr")
    lines += [
        f"{n} always instead of at most: {ratio(always, at_most[n]):.1f} times the time, "
        f"{span(differences(always, at_most[n], 'psnr'), 'dB')}"
        for n in (1, 2, 3)
        if (always := by_data(rows, "lobes", f"{n} always"))
    ]
    return f"The first lobe gains {span(first, 'dB')}; " + "; ".join(lines) + "."


def classes(rows: Sequence[Row]) -> str:
    """What pixels that need fewer lobes save."""
    by_data: dict[str, dict[str, float]] = {}
    for row in of_knob(rows, "classes"):
        by_data.setdefault(row["data"], {})[row["setting"]] = row["cost"]["cpu"]
    lines = []
    for name in ("no lobe", "one lobe"):
        saved = [
            1.0 - found[name] / found["two lobes"]
            for found in by_data.values()
            if name in found and "two lobes" in found
        ]
        if saved:
            lines.append(f"with {name} {share(saved)}")
    if not lines:
        raise ValueError
    return f"Time saved against pixels with two lobes: {', '.join(lines)}."


def reflectance(rows: Sequence[Row]) -> str:
    """What estimators of reflectance are worth, instead of Wiener's."""
    usual = by_data(rows, "reflectance", "wiener")
    others = dict.fromkeys(r["setting"] for r in of_knob(rows, "reflectance") if r["options"])
    lines = []
    for name in others:
        some = by_data(rows, "reflectance", name)
        if name == "wiener" or not some:
            continue
        spectra = [100.0 * value for value in differences(some, usual, "spectrum")]
        lines.append(
            f'`"{name}"` {ratio(some, usual):.1f} times the time, colours '
            f"{span(differences(some, usual, 'colour'), 'ΔE00', 2)}, "
            f"spectra {span(spectra, '%', 2)} of white"
        )
    if not lines:
        raise ValueError
    said = f'Against `"wiener"`: {"; ".join(lines)}.'
    if product := by_data(rows, "reflectance", wiener_numpy.NAME):
        off = max(abs(value) for value in differences(product, usual, "colour"))
        said += (
            f" The same estimate by one matrix product of numpy takes {ratio(product, usual):.1f} "
            f"times the time; mean colour differences agree to {off:.1g} ΔE00."
        )
    return said


def bits(rows: Sequence[Row]) -> str:
    """What coarser numbers cost."""
    full = levels(rows, "bits", "float32", "psnr")
    lines = []
    for sort in ("8-bit linear", "8-bit sRGB", "12-bit linear", "float16"):
        some = levels(rows, "bits", sort, "psnr")
        lines.append(f"{sort} {span([some[data] - full[data] for data in full], 'dB')}")
    return "Against float32: " + ", ".join(lines) + "."


def peers(rows: Sequence[Row]) -> str:
    """Who is not beaten."""
    every, left = compared(rows), unbeaten(rows)
    if not every:
        raise ValueError
    wholly = sum(beaten(peer, rows, wholly=True) for peer in every)
    as_well = f"{wholly} of them by a fit that is no worse in decibels and ΔE00"
    if not left:
        return f"A fit of impasto is as fast and as accurate as every peer; {as_well}."
    best: Callable[[Row], Any] = lambda row: row["error"]["psnr"]  # noqa: E731
    lines = [
        f"{len(every) - len(left)} of {len(every)} peers are beaten by a fit of impasto in both "
        f"time and error of relighting; {as_well}. Not beaten:\n"
    ]
    for data in dict.fromkeys(row["data"] for row in left):
        # In italics: some names have commas.
        names = [f"*{r['setting']}*" for r in sorted(left, key=best) if r["data"] == data]
        lines.append(f"* {SETS[data]}: {', '.join(names)}.")
    return "\n".join(lines)


def memory(rows: Sequence[Row]) -> str:
    """What fits need beyond the photographs."""
    held = {name: row["memory"] for name, row in preset_rows(rows) if row.get("memory")}
    own, views = held["lobes per pixel, standard"], held["Lafortune"]
    return (
        "Peak memory beyond the photographs, per megapixel of one photograph: "
        f"{own:.0f} MB with lobes per pixel, {held['one lobe']:.0f} MB with one lobe "
        f"(48 photographs, three bands), {views:.0f} MB with Lafortune lobes (700 views)."
    )


def size(rows: Sequence[Row]) -> str:
    """What a large picture takes, pixel for pixel."""
    small = named(rows)
    lines, times = [], 0
    for row in of_knob(rows, "size"):
        name = row["setting"]
        preset = preset_of(row["options"])
        if "effort" in row["options"] and name != f"lobes per pixel, {preset}":
            continue  # measured before the preset was what it is
        before = small[name][row["data"]]["cost"]["cpu"]
        lines.append(f"{name} {row['cost']['cpu']:.1f} instead of {before:.1f}")
        times = row["number"]
    if not lines:
        raise ValueError
    return (
        f"A picture {times} times as large takes, in CPU seconds per megapixel: {'; '.join(lines)}."
    )


def wall(rows: Sequence[Row]) -> str:
    """How long one waits for a second of a processor's time."""
    times = [row["cost"]["wall"] / row["cost"]["cpu"] for row in rows]
    return f"Wall-clock times are {min(times):.2f} to {max(times):.2f} times these CPU seconds."


def again(rows: Sequence[Row]) -> str:
    """What a second run says."""
    rows = [row for row in rows if "again" in row]
    if not rows:
        raise ValueError
    same = sum(row["again"]["same"] for row in rows)
    fits, pairs = (np.array(shares) for shares in apart(rows))
    doubts = [doubt for row in rows for doubt in (row["doubt"], row["again"]["doubt"]) if doubt]
    return (
        f"A second run reproduces the errors of {same} of {len(rows)} fits bit for bit. Its costs, "
        f"relative to their median, agree within a tenth for {int((fits <= TENTH).sum())} of "
        f"{len(fits)} fits (median difference {100.0 * float(np.median(fits)):.1f} %, largest "
        f"{100.0 * float(fits.max()):.0f} %), and so do "
        f"{100.0 * float((pairs <= TENTH).mean()):.1f} % of the {len(pairs)} ratios of two fits of "
        "a data set. The estimated standard error of a cost is "
        f"{100.0 * float(np.median(doubts)):.1f} % (median; at most "
        f"{100.0 * max(doubts):.1f} %) after {min(row['timings'] for row in rows)} to "
        f"{max(row['timings'] for row in rows)} timings."
    )


SENTENCES = (
    choice, promises, enough, photographs, bound, views, doubt, steps, starts, searches, precision,
    excess, lobes, classes, bits, reflectance, peers, memory, size, wall, again,
)  # fmt: skip
"""In the order of the page; each raises where a study has not measured what it is about."""
