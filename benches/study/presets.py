"""Presets derived from a study, and checks of the presets that impasto has."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass

from impasto._internal.wording import counted
from impasto.effort import PRESETS, Effort
from study.candidates import BEST, Candidate, Row, candidates_of, chosen, sparing

PIXELS = {"draft": 1 << 12, "standard": 1 << 16, "reference": 1 << 18}
"""With 65536 pixels the relative error of the painting's beta and gamma is a thousandth, with a
sixteenth of them four thousandths, with four times as many half of one."""
FAIR = ("effort", "precision", "pooling", "pixels", "lobes", "starts", "robust")
"""Knobs with whose settings a preset is compared: our fits to all photographs."""
SAME = 0.05
"""Smaller differences of time or error do not count: timings of runs differ as much."""
FASTER = 8.0
"""Speed of ``draft`` relative to ``standard``, unless nothing as fast is better."""


@dataclass(frozen=True, slots=True)
class Check:
    """One promise of a preset.

    Attributes
    ----------
    preset, promise
        Whose, and which.
    found
        What the study says.
    kept
        Whether it is so.
    """

    preset: str
    promise: str
    found: str
    kept: bool


def grid_name(effort: Effort) -> str:
    """The name of an effort on the grid that presets are chosen from."""
    steps = f"{counted(effort.rounds, 'round')}, {counted(effort.iterations, 'step')}"
    if effort.colour_iterations is not None:
        steps += f", {effort.colour_iterations} in colour"
    start = "" if effort.start == "multistart" else f", {effort.start}"
    precision = "" if effort.precision == "single" else f", {effort.precision}"
    return steps + start + precision


def derived(rows: Iterable[Row]) -> dict[str, Effort]:
    """The presets derived from a study's rows.

    ``pixels`` is no result of the study, whose pictures are smaller: a lobe's error falls with the
    root of the pixels that it is looked for among (:data:`PIXELS`).
    """
    grid = chosen(_grid(rows))
    return {name: effort_of(candidate.options, PIXELS[name]) for name, candidate in grid.items()}


def effort_of(options: Row, pixels: int) -> Effort:
    """The effort of a row, except ``pixels``; fields that it does not name are the defaults."""
    return Effort(**options["effort"] | {"pixels": pixels})


def preset_of(options: Row) -> str | None:
    """The name of the effort that a row was measured with, if it has one.

    On pictures of the study's size ``pixels`` makes no difference.
    """
    if "effort" not in options:
        return None
    same = (name for name, own in PRESETS.items() if effort_of(options, own.pixels) == own)
    return next(same, None)


def call(options: Row) -> str:
    """The arguments of :func:`impasto.fit_sbrdf`, as Python."""
    others = {name: value for name, value in options.items() if name != "effort"}
    words = [_written(others)] if others else []
    if "effort" in options and (name := preset_of(options)) != "standard":
        usual = Effort().to_dict()
        own = {n: value for n, value in options["effort"].items() if value != usual[n]}
        words.append(f"effort=Effort({_written(own)})" if name is None else f'effort="{name}"')
    return f"`{', '.join(words)}`" if words else '`pooling="painting"`'


def _written(arguments: Row) -> str:
    return ", ".join(f"{name}={value!r}" for name, value in arguments.items()).replace("'", '"')


def checked(rows: Iterable[Row], presets: Mapping[str, Effort] = PRESETS) -> list[Check]:
    """Whether the presets keep what they promise.

    Raises
    ------
    KeyError
        One of them was not measured on every data set; it is named.
    """
    rows = list(rows)
    grid = _grid(rows)
    own = {name: _candidate(grid, name, effort) for name, effort in presets.items()}
    draft, standard, reference = own["draft"], own["standard"], own["reference"]
    best, surest = (min(some, key=lambda c: c.error) for some in (grid, sparing(grid)))
    shown = min(grid, key=lambda candidate: candidate.shown)
    everywhere = {row["data"] for row in rows if row["knob"] == "effort"}
    # Fits without ambient light know that the simulations have none.
    fair = [
        row
        for row in rows
        if row["knob"] in FAIR and row["data"] in everywhere and "ambient" not in row["options"]
    ]
    others = candidates_of(fair)
    better, fast = _better(others, standard), _as_fast(others, draft)
    return [
        Check(
            "standard", "nothing is both faster and more accurate by more than 5 %",
            _said(better, standard), not better,
        ),
        Check(
            "reference", "within 1 % of the least error of those that weigh and flag like it",
            _above(reference.error, surest.error, surest),
            reference.error <= BEST * surest.error,
        ),
        Check(
            "reference", "within 1 % of the least error of any rounds, steps and start",
            _above(reference.error, best.error, best),
            reference.error <= BEST * best.error,
        ),
        Check(
            "reference", "within 1 % of the least error of held-out photographs alone, of any",
            _above(reference.shown, shown.shown, shown),
            reference.shown <= BEST * shown.shown,
        ),
        Check(
            "draft", "8 times faster than standard, or nothing as fast is better by more than 5 %",
            f"{standard.seconds / draft.seconds:.1f} times faster, and "
            + (_said(fast, draft) if fast else "nothing as fast is better by as much"),
            standard.seconds >= FASTER * draft.seconds or not fast,
        ),
    ]  # fmt: skip


def table(rows: Iterable[Row]) -> list[Row]:
    """The checks as rows of a table; none where the presets were not measured."""
    try:
        return [asdict(check) for check in checked(rows)]
    except KeyError:
        return []


def explained(rows: Iterable[Row]) -> str:
    """The derived presets beside the existing ones, and the checks, as text."""
    rows = list(rows)
    lines = []
    for name, effort in derived(rows).items():
        mark = "as it is" if effort == PRESETS[name] else f"is {PRESETS[name]}"
        lines.append(f"{name}: {effort} ({mark})")
    for check in checked(rows):
        word = "kept" if check.kept else "BROKEN"
        lines.append(f"{word}: {check.preset}: {check.promise}: {check.found}")
    return "\n".join(lines)


def _grid(rows: Iterable[Row]) -> list[Candidate]:
    return candidates_of(row for row in rows if row["knob"] == "effort")


def _candidate(grid: list[Candidate], name: str, effort: Effort) -> Candidate:
    for candidate in grid:
        if effort_of(candidate.options, effort.pixels) == effort:
            return candidate
    raise KeyError(name)


def _above(error: float, least: float, best: Candidate) -> str:
    if error <= least:
        return "nothing is better"
    return f"{100.0 * (error / least - 1.0):.1f} % above {best.setting}"


def _better(others: list[Candidate], candidate: Candidate) -> list[Candidate]:
    share = 1.0 - SAME
    return [
        o
        for o in others
        if o.seconds < share * candidate.seconds and o.error < share * candidate.error
    ]  # fmt: skip


def _as_fast(others: list[Candidate], candidate: Candidate) -> list[Candidate]:
    share = 1.0 - SAME
    return [
        o for o in others if o.seconds <= candidate.seconds and o.error < share * candidate.error
    ]


def _said(better: list[Candidate], candidate: Candidate) -> str:
    if not better:
        return "nothing is"
    most = min(better, key=lambda other: other.error)
    time, error = (
        100.0 * (1.0 - a / b)
        for a, b in ((most.seconds, candidate.seconds), (most.error, candidate.error))
    )
    return f"{most.setting} takes {time:.0f} % less, is off by {error:.0f} % less"
