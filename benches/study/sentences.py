"""What a study's rows say, in sentences: every number on the page comes from the record."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, get_args

import numpy as np

from impasto._internal.wording import counted
from impasto.effort import PRESETS, Effort, Origin
from study import wiener_numpy
from study.candidates import Row
from study.excess_cost import PRECISIONS, STEPS
from study.formatting import between, by_data, differences, levels, named, ratio, share, span
from study.presets import checked, grid_name
from study.recommendations import choice, enough
from study.repeatability import TENTH, apart
from study.tables import SETS, beaten, compared, of_knob, preset_rows, searched_in, unbeaten
from study.treatments import SELECTIONS

VIEWS = "770 views"
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
        lines.append(
            f"{count} lights cost {losses['random']:.1f} dB at random, {losses['spread']:.1f} dB "
            f"spread, {losses['best']:.1f} dB as the best found"
        )
    return "In the mean of the data sets " + "; ".join(lines) + "."


def bound(rows: Sequence[Row]) -> str:
    """How near the presets come to what no fit can beat."""
    own = {name: named(rows)[f"pixels' own, {name}"]["own model"] for name in PRESETS}
    said = ", ".join(
        f'`"{name}"` {row["error"]["normal"] / row["bound"]:.2f}, {row["width"]:.2f} and '
        f"{row['strength']:.2f}"
        for name, row in own.items()
    )
    return (
        "With all photographs of the simulated paintings, normals (in the mean), widths and "
        "strengths of gloss (in the median) are off by so many times their bounds: "
        f"{said}. The bound of a strength knows that varnish has no colour; a fit has to find out."
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
        "Heuberger (2005) says of the rig of 770 views (the third paper's) that its sampling can "
        f"be cut 40 to 100 times for about 1 dB. Here {verdict}. Against all photographs, for each "
        f"number by whichever choice is best: {rest}. The "
        "surface is one that the fit can describe exactly and held-out photographs have no noise: "
        f"from {every:.0f} dB there is far to fall, where photographs of a real painting have a "
        "floor. Random choices whose lights lie in one plane, which no fit takes, are drawn again."
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
        "Weighing samples by what is left of them (with normals that start from robust "
        f"photometric stereo) costs {time:.2f} times the time of doing neither, "
        f"and changes held-out photographs by {span(differences(both, none, 'psnr'), 'dB')}, "
        f"normals by {span(differences(both, none, 'normal'), '°', 3)}; pixels that are flagged "
        f"fall from {100 * flagged[0]:.0f} % to {100 * flagged[1]:.1f} %."
    )


def steps(rows: Sequence[Row]) -> str:
    """What more steps are worth, of photographs and of normals."""
    rounds = PRESETS["standard"].rounds
    few, many = (
        by_data(rows, "effort", grid_name(effort))
        for effort in (Effort(rounds=rounds, iterations=n, start="table") for n in (2, 10))
    )

    def changed(what: str) -> str:
        pairs = [(few[data]["error"][what], many[data]["error"][what]) for data in few]
        return span([100.0 * (b / a - 1.0) for a, b in pairs if a is not None], "%", 0)

    return (
        f"From the table of widths and with {counted(rounds, 'round')} ten steps instead of two "
        f"take {ratio(many, few):.1f} times the time, and change the error of held-out "
        f"photographs by {changed('relative')}, that of normals by {changed('normal')}."
    )


def starts(rows: Sequence[Row]) -> str:
    """Whether it matters where the search starts."""
    found = [row["setting"] for row in of_knob(rows, "starts")]
    others = [name for name in dict.fromkeys(found) if name != "robust"]
    own = levels(rows, "starts", "robust", "psnr")
    angles = levels(rows, "starts", "robust", "normal")
    gains, turns = [], []
    for name in others:
        some, more = (levels(rows, "starts", name, what) for what in ("psnr", "normal"))
        gains += [some[data] - own[data] for data in own]
        turns += [more[d] - angle for d, angle in angles.items() if angle is not None]
    return (
        f"The search starts at normals of photometric stereo. From those of {len(others)} other "
        f"methods than the default it comes to {span(gains, 'dB')} and {span(turns, '°', 3)} of "
        "the same."
    )


def searches(rows: Sequence[Row]) -> str:
    """What it is worth to start from what pixels about have found."""
    table, pyramid = (
        by_data(rows, "effort", grid_name(effort))
        for effort in (replace(PRESETS["standard"], start=start) for start in get_args(Origin))
    )
    return (
        'Searches that start from what pixels of a coarse grid found (`Effort(start="pyramid")`) '
        f"take {ratio(pyramid, table):.2f} times the time of those from a table of widths, and "
        f"change held-out photographs by {span(differences(pyramid, table, 'psnr'), 'dB')}, "
        f"normals by {span(differences(pyramid, table, 'normal'), '°', 3)}."
    )


def precision(rows: Sequence[Row]) -> str:
    """What it is worth to search in double precision."""
    found: dict[str, dict[str, Row]] = {}
    for row in of_knob(rows, "precision"):
        found.setdefault(row["setting"], {})[row["data"]] = row
    lines = [
        f"{what} takes {ratio(found[name], found['single']):.2f} times the time, and changes "
        f"held-out photographs by {span(differences(found[name], found['single'], 'psnr'), 'dB')}"
        f", normals by {span(differences(found[name], found['single'], 'normal'), '°', 3)}"
        for name, what in {
            "polished": "a last round that goes on in double precision",
            "double": "every search in double precision",
        }.items()
    ]
    said = "; ".join(lines)
    return f"{said[0].upper()}{said[1:]}."


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
        f'A search that may take {few} steps, as many as `"standard"` has, ends {single} above the '
        f"least cost in single precision (the 99th percentile), {double} in double; {bad(few)} of "
        "the pixels, depending on the data, end more than a hundredth above it. With "
        f"{many} steps it is {both(many, 'p99')}, half of the pixels are within "
        f"{both(many, 'median')}, and {bad(many)} are in a bad basin."
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
    matte = differences(at_most[1], at_most[0], "psnr")
    lines += [
        f"{n} always instead of at most: {ratio(always, at_most[n]):.1f} times the time, "
        f"{span(differences(always, at_most[n], 'psnr'), 'dB')}"
        for n in (1, 2, 3)
        if (always := by_data(rows, "lobes", f"{n} always"))
    ]
    return f"The first lobe is worth {span(matte, 'dB')}; " + "; ".join(lines) + "."


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
            lines.append(f"those with {name} save {share(saved)} of the time")
    if not lines:
        raise ValueError
    return "Against pixels that get two lobes " + ", ".join(lines) + "."


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
            f'`"{name}"` takes {ratio(some, usual):.1f} times the time, and changes colours by '
            f"{span(differences(some, usual, 'colour'), 'ΔE00', 2)}, "
            f"spectra by {span(spectra, '%', 2)} of white"
        )
    if not lines:
        raise ValueError
    said = f"Instead of Wiener's estimate {'; '.join(lines)}."
    if product := by_data(rows, "reflectance", wiener_numpy.NAME):
        off = max(abs(value) for value in differences(product, usual, "colour"))
        said += (
            f" Wiener's by one product of numpy's takes {ratio(product, usual):.1f} times the time "
            f"of ours; mean colour differences are the same to {off:.1g} ΔE00."
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
    as_well = f"{wholly} of them by a fit that is no worse in decibels and ΔE00 either"
    if not left:
        return (
            "Every peer is beaten: some fit of ours is at least as cheap and relights at least as "
            f"well; {as_well}."
        )
    best: Callable[[Row], Any] = lambda row: row["error"]["psnr"]  # noqa: E731
    lines = [
        f"{len(every) - len(left)} of {len(every)} peers that show photographs are beaten by a fit "
        f"of ours in both time and error of relighting; {as_well}. Not beaten:\n"
    ]
    for data in dict.fromkeys(row["data"] for row in left):
        # In italics: some names have commas.
        names = [f"*{r['setting']}*" for r in sorted(left, key=best) if r["data"] == data]
        lines.append(f"* {SETS[data]}: {', '.join(names)}.")
    return "\n".join(lines)


def memory(rows: Sequence[Row]) -> str:
    """What fits need beyond the photographs."""
    held = {name: row["memory"] for name, row in preset_rows(rows) if row.get("memory")}
    own, views = held["pixels' own, standard"], held["Lafortune"]
    return (
        "Beyond the photographs themselves a fit takes, at its peak, for every megapixel of one "
        f"photograph: {own:.0f} MB with pixels' own lobes, {held['one lobe']:.0f} MB with one lobe "
        f"(48 photographs with three bands), {views:.0f} MB with Lafortune lobes of 700 views."
    )


def size(rows: Sequence[Row]) -> str:
    """What a large picture takes, pixel for pixel."""
    small = named(rows)
    lines, times = [], 0
    for row in of_knob(rows, "size"):
        name = row["setting"]
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
    return (
        "By the clock on the wall the same fits take "
        f"{min(times):.2f} to {max(times):.2f} times their CPU seconds."
    )


def again(rows: Sequence[Row]) -> str:
    """What a second run says."""
    rows = [row for row in rows if "again" in row]
    if not rows:
        raise ValueError
    same = sum(row["again"]["same"] for row in rows)
    fits, pairs = (np.array(shares) for shares in apart(rows))
    doubts = [doubt for row in rows for doubt in (row["doubt"], row["again"]["doubt"]) if doubt]
    return (
        f"A second run, in a process of its own, finds the errors of {same} of {len(rows)} fits "
        "the same bit for bit, and of their costs, in proportion to all others, "
        f"{int((fits <= TENTH).sum())} of {len(fits)} within a tenth: half of them within "
        f"{100.0 * float(np.median(fits)):.1f} %, the farthest {100.0 * float(fits.max()):.0f} %. "
        f"Of the {len(pairs)} ratios of any two fits of a data set "
        f"{100.0 * float((pairs <= TENTH).mean()):.1f} % are within a tenth. Costs are thought "
        f"to be known to {100.0 * float(np.median(doubts)):.1f} % (standard error, the median; "
        f"{100.0 * max(doubts):.1f} % at most), after {min(row['timings'] for row in rows)} to "
        f"{max(row['timings'] for row in rows)} timings of the first run."
    )


SENTENCES = (
    choice, promises, enough, photographs, bound, views, doubt, steps, starts, searches, precision,
    excess, lobes, classes, bits, reflectance, peers, memory, size, wall, again,
)  # fmt: skip
"""In the order of the page; each raises where a study has not measured what it is about."""
