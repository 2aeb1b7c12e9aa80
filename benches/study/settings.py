"""The settings that are compared: a plain list, one fit each."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, TypeAlias, get_args

import numpy as np

from impasto._internal.wording import counted
from impasto.effort import PRESETS, Effort, Origin, Precision
from impasto.fit.normals import Method
from impasto.fit.reflectance import Estimator
from study import excess_cost, fits, minpack, peers, subsets, treatments, wiener_numpy
from study.data_sets import PIGMENTS
from study.held_out_error import compared
from study.pigments import judged_spectra
from study.presets import grid_name, preset_of

Fit: TypeAlias = Callable[[Any, int | None], Any]
Prepare: TypeAlias = Callable[[Any, int], Any]
Part: TypeAlias = Callable[[Any], Any]
Judge: TypeAlias = Callable[[Sequence[Any], Any], Any]

VIEWS = "770 views"
SIMULATED = ("own model", "shifted gamma", "ABC")
ONE_VIEW = (*SIMULATED, "icon")
COUNTS = (6, 9, 14, 24)
"""Numbers of lights kept, of 48 or (icon) 60."""
LIGHTS = {48: SIMULATED, 60: ("icon",)}
"""Lights that a data set has, and the data sets."""
VIEW_COUNTS = (7, 12, 18, 35, 70, 175, 350)
"""Numbers of photographs kept of 700: a hundredth to a half."""
LARGE = 8
"""A picture so many times as wide and as high shows how the time depends on the size."""
PER_PIXEL = {"pooling": "pixel"}
ESTIMATORS: tuple[Estimator, ...] = (
    "wiener", "linear-model", "root-polynomial", "radial-basis",
)  # fmt: skip
"""Reflectance estimators; the quick study takes every other."""
ONE_LOBE = "one lobe"
"""The default fit."""


@dataclass(frozen=True)
class Setting:
    """One fit to be measured.

    Attributes
    ----------
    knob
        The parameter that is varied; settings of one knob are compared with each other.
    name
        Unique within the knob, on each data set.
    fit
        ``(stack, threads)``, timed. What a stack is, the data sets say: photographs of a painting
        under many lights, or one photograph of pigments.
    on
        Data sets that it is meant for.
    prepare
        ``(stack, seed)``, before the clock runs: fewer lights, fewer bits.
    options
        What :func:`impasto.fit_sbrdf` is given, the effort as its numbers; empty for anything else.
    number
        Where the setting stands on the knob's scale.
    part
        Which pixels of a data set: all of them, or fewer of what is too slow.
    judge
        ``(fits, parts)``: the errors, a dataclass whose names are those of a row's ``error``.
    """

    knob: str
    name: str
    fit: Fit
    on: tuple[str, ...]
    prepare: Prepare = treatments.everything
    options: dict[str, Any] = field(default_factory=dict)
    number: float | None = None
    part: Part = subsets.whole
    judge: Judge = compared

    @property
    def peer(self) -> bool:
        """Whether it is another program's method."""
        return self.knob == "peer"

    @property
    def search(self) -> bool:
        """Whether it is a search alone, whose final cost is compared with the least cost."""
        return self.knob == "search"


def settings(*, quick: bool = False) -> list[Setting]:
    """All settings; quick: a few of every knob and the presets, without large pictures."""
    every = [setting for setting in _all() if not (quick and setting.knob == "size")]
    if not quick:
        return every
    knobs: dict[str, dict[str, None]] = {}
    for setting in every:
        knobs.setdefault(setting.knob, {})[setting.name] = None
    few = {(knob, name) for knob, names in knobs.items() for name in _spread([*names], 3)}
    return [s for s in every if (s.knob, s.name) in few or named(s)]


def named(setting: Setting) -> bool:
    """Whether it is a default or a preset."""
    preset = setting.knob == "effort" and preset_of(setting.options) is not None
    return setting.knob == "pooling" or preset


def _spread(names: list[str], count: int) -> list[str]:
    places = np.linspace(0, len(names) - 1, min(count, len(names))).round().astype(int)
    return [names[place] for place in places]


def _sbrdf(knob: str, name: str, on: tuple[str, ...], /, **more: Any) -> Setting:
    keep = {key: more.pop(key) for key in ("prepare", "number", "part") if key in more}
    options = {k: v.to_dict() if isinstance(v, Effort) else v for k, v in more.items()}
    return Setting(knob, name, partial(fits.sbrdf, **more), on, options=options, **keep)


def _all() -> Iterator[Setting]:
    yield from _efforts()
    yield from _lobes()
    yield from _photographs()
    yield from _reflectances()
    for name in treatments.NUMBER_FORMATS:
        prepare = partial(treatments.recoded, number_format=name)
        yield _sbrdf("bits", name, SIMULATED, **PER_PIXEL, prepare=prepare)
    for method in get_args(Method):
        yield Setting("normals", method, partial(fits.lambert, method=method), ONE_VIEW)
        yield _sbrdf("starts", method, ONE_VIEW, **PER_PIXEL, normals=method)
    for name, fit in peers.PEERS.items():
        yield Setting("peer", name, fit, ONE_VIEW)
    some = partial(subsets.strided, stride=minpack.STRIDE)
    yield Setting("peer", minpack.NAME, minpack.fit, ONE_VIEW, part=some)
    # A sample of pixels has no neighbours to start from.
    effort = replace(PRESETS["standard"], start="multistart")
    alone: dict[str, Any] = {**PER_PIXEL, "effort": effort, "part": some}
    yield _sbrdf("sample", "ours, MINPACK's pixels", ONE_VIEW, **alone)
    one = "ours, one lobe, MINPACK's pixels"
    yield _sbrdf("sample", one, ONE_VIEW, **alone, lobes=1, ambient=False)
    for precision in excess_cost.PRECISIONS:
        for steps in excess_cost.STEPS:
            search = partial(fits.search, effort=excess_cost.effort_of(precision, steps))
            name = f"{precision}, {counted(steps, 'step')}"
            yield Setting("search", name, search, ONE_VIEW, number=steps, part=some)


def _efforts() -> Iterator[Setting]:
    """The grid that presets are chosen from, and options that presets do not change."""
    for start in get_args(Origin):
        for rounds in (0, 1, 2, 4):
            for iterations in (1, 2, 3, 4, 6, 10, 30):
                effort = Effort(rounds=rounds, iterations=iterations, start=start)
                yield _sbrdf("effort", grid_name(effort), ONE_VIEW, **PER_PIXEL, effort=effort)
        for rounds, iterations in ((1, 3), (1, 4), (1, 6), (2, 4), (2, 6), (2, 10), (3, 6)):
            for colour in (1, 2, 3):
                if colour < iterations:
                    effort = Effort(
                        rounds=rounds, iterations=iterations, colour_iterations=colour, start=start
                    )
                    yield _sbrdf("effort", grid_name(effort), ONE_VIEW, **PER_PIXEL, effort=effort)
    for precision in get_args(Precision):
        effort = Effort(precision=precision)
        yield _sbrdf("precision", precision, ONE_VIEW, **PER_PIXEL, effort=effort)
    yield _sbrdf("pooling", "one lobe, as the papers have it", ONE_VIEW, joint=False)
    yield _sbrdf("pooling", ONE_LOBE, ONE_VIEW)
    yield _sbrdf("pooling", "Lafortune", (VIEWS,), model="lafortune")
    large: dict[str, Any] = {"part": partial(subsets.repeated, times=LARGE), "number": LARGE**2}
    yield _sbrdf("size", "one lobe, as the papers have it", SIMULATED[:1], joint=False, **large)
    yield _sbrdf("size", ONE_LOBE, SIMULATED[:1], **large)
    for preset, effort in PRESETS.items():
        own: dict[str, Any] = PER_PIXEL | {"effort": effort}
        yield _sbrdf("size", f"lobes per pixel, {preset}", SIMULATED[:1], **own, **large)
    for pixels in (1 << 8, 1 << 10):
        effort = Effort(pixels=pixels)
        yield _sbrdf("pixels", f"{pixels} pixels", ONE_VIEW, effort=effort, number=pixels)
    for stereo in (0, 1, 2, 5, 10):
        fit = partial(fits.lambert, method="robust", effort=Effort(stereo=stereo))
        yield Setting("stereo", counted(stereo, "step"), fit, ONE_VIEW, number=stereo)
    for start, method in {"off": "least-squares", "on": "robust"}.items():
        for samples, rounds in {"off": 0, "on": 2}.items():
            name = f"stereo {start}, samples {samples}"
            effort = Effort(rounds=rounds)
            yield _sbrdf("robust", name, ONE_VIEW, **PER_PIXEL, normals=method, effort=effort)


def _lobes() -> Iterator[Setting]:
    """The largest number of lobes; BIC selects fewer where they do not improve the fit."""
    yield Setting("lobes", "none", partial(fits.lambert, method="robust"), ONE_VIEW, number=0)
    for lobes in (1, 2, 3):
        name = f"{lobes} at most"
        yield _sbrdf("lobes", name, ONE_VIEW, **PER_PIXEL, lobes=lobes, number=lobes)
        yield _sbrdf("lobes", f"Lafortune, {name}", (VIEWS,), model="lafortune", lobes=lobes)
        always = partial(fits.always, lobes=lobes)
        yield Setting("lobes", f"{lobes} always", always, ONE_VIEW, number=lobes)
    yield _sbrdf("lobes", "2 at most, no ambient light", ONE_VIEW, **PER_PIXEL, ambient=False)
    for count, name in enumerate(("no lobe", "one lobe", "two lobes")):
        part = partial(subsets.alike, lobes=count)
        yield _sbrdf("classes", name, ONE_VIEW, **PER_PIXEL, part=part, number=count)


def _photographs() -> Iterator[Setting]:
    for choice in treatments.SELECTIONS:
        for count in COUNTS:
            yield _sbrdf(
                "lights", f"{count} {choice}", ONE_VIEW, **PER_PIXEL, number=count,
                prepare=partial(treatments.fewer, count=count, choice=choice),
            )  # fmt: skip
        for count in VIEW_COUNTS:
            yield _sbrdf(
                "views", f"{count} {choice}", (VIEWS,), model="lafortune", number=count,
                prepare=partial(treatments.fewer, count=count, choice=choice),
            )  # fmt: skip
    # With few lights the default is the better fit.
    for count in COUNTS:
        fewer = partial(treatments.fewer, count=count, choice="spread")
        name = f"{count} spread, {ONE_LOBE}"
        yield _sbrdf("lights", name, ONE_VIEW, number=count, prepare=fewer)
    for count, on in LIGHTS.items():
        yield _sbrdf("lights", "all", on, **PER_PIXEL, number=count)
    yield _sbrdf("views", "all", (VIEWS,), model="lafortune", number=700)


def _reflectances() -> Iterator[Setting]:
    """Estimators have errors of their own kind; a setting without options is a peer."""
    for estimator in ESTIMATORS:
        yield Setting(
            "reflectance", estimator, partial(fits.reflectance, estimator=estimator), PIGMENTS,
            options={"estimator": estimator}, judge=judged_spectra,
        )  # fmt: skip
    yield Setting(
        "reflectance", wiener_numpy.NAME, wiener_numpy.fit, PIGMENTS, judge=judged_spectra
    )
