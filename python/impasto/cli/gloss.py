"""Options of `fit` for the model of the gloss, and which of them go together."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import CycloptsError, Group, Parameter

from impasto._internal.checks import refractive_index
from impasto.cli.options import SomeWhole
from impasto.errors import ArgumentError
from impasto.fit.lobes import lobe_count
from impasto.fit.options import FitKind, Model, Pooling, fit_kind, fit_kinds, takers
from impasto.systems import Name

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from impasto.stack import Stack
    from impasto.systems import System

GROUP = Group("Gloss", sort_key=2)

LAFORTUNE: Name = "snel-lafortune"
"""The system whose model is ``"lafortune"``."""


@Parameter(name="*", group=GROUP)
@dataclass(frozen=True, kw_only=True)
class Gloss:
    """Options of :func:`impasto.fit_sbrdf` on the command line."""

    model: Model = "torrance-sparrow"
    """The lobe of the first two papers, or up to three lobes of the third paper per pixel, which
    need hundreds of photographs."""

    pooling: Pooling = "auto"
    """One gloss for the painting, one per segment, or lobes per pixel (gilding, metal leaf, uneven
    varnish). auto: none, for the painting or per pixel, whichever predicts held-out photographs
    best. Lafortune lobes are always per pixel."""

    segments: Annotated[Path | None, Parameter(metavar="PICTURE")] = None
    """With --pooling segment: a picture as large as the photographs (PNG or TIFF) in which every
    segment has its own grey or colour; black belongs to none."""

    lobes: SomeWhole = None
    """Lobes per pixel: how many at most, 1 to 3; default: 2, with --model lafortune 3."""

    ambient: Annotated[bool | None, Parameter(negative="--no-ambient")] = None
    """Lobes per pixel: include ambient light in the model; default: yes."""

    coated: Annotated[bool | None, Parameter(negative="--no-coated")] = None
    """One lobe for the painting, or lobes per pixel: diffuse light crosses a varnish; default: no,
    or with --pooling auto whichever predicts held-out photographs best."""

    def check(self, *, system: str, steps: dict[str, Any]) -> None:
        """Refuse options that exclude each other; ``steps``: options of the procedure."""
        kinds = self._kinds(system=system, steps=steps)
        kind = kinds[0]
        word = _in_words(kind)
        for name in kind.idle({**self._own(), **steps}):
            others = " or ".join(map(_in_words, takers(name)))
            raise CycloptsError(msg=f"--{name} goes with {others}: {word} has no --{name}")
        # Numbers are checked before photographs are read, too.
        if self.lobes is not None:
            lobe_count(self.lobes)
        if steps.get("index") is not None:
            refractive_index(steps["index"])
        if "segments" in kind.defaults and self.segments is None:
            raise CycloptsError(
                msg=f"{word} needs --segments, a picture in which every segment has its own "
                "grey or colour"
            )
        own = ("model", "lafortune") if system == LAFORTUNE else ("pooling", "painting")
        if system != "impasto" and kind.chosen != own:
            raise CycloptsError(
                msg=f"{word} excludes --system {system}: its paper has one gloss per painting"
            )

    def is_open(self, *, system: str, steps: dict[str, Any]) -> bool:
        """Whether no option says what is fitted."""
        given = {**self._own(), **steps} | {"index": None}
        nothing = all(value is None for value in given.values())
        usual = (system, self.model, self.pooling) == ("impasto", "torrance-sparrow", "auto")
        return usual and nothing

    def options(self, procedure: System, *, steps: dict[str, Any]) -> dict[str, Any]:
        """All arguments of :func:`impasto.fit_sbrdf`; segments are still a path."""
        kinds = self._kinds(system=procedure.name, steps=steps)
        given = {**procedure.options, **self._own()}
        if len(kinds) > 1:
            shared = {name: given[name] for name in kinds[0].defaults if _everywhere(name, kinds)}
            return {"model": self.model, "pooling": "auto", **shared}
        kind = kinds[0]
        own = kind.complete({name: given[name] for name in kind.defaults})
        return {"model": kind.model, "pooling": kind.pooling, **own}

    def _kinds(self, *, system: str, steps: dict[str, Any]) -> list[FitKind]:
        """The fits among which photographs decide, or the one that the options ask for."""
        model: Model = "lafortune" if system == LAFORTUNE else self.model
        painting = model == "torrance-sparrow" and system != "impasto"
        own = {**self._own(), **steps}
        if self.pooling == "auto" and painting and not _others(own):
            return [fit_kind(model, "painting")]
        if self.pooling == "auto" and model == "lafortune":
            return [fit_kind(model, "pixel")]
        try:
            return fit_kinds(model, self.pooling, own)
        except ArgumentError as error:
            if self.pooling == "auto":
                raise CycloptsError(msg=_dashed(own)) from error
            # Each value is valid: these two exclude each other.
            words = f"--model {model} excludes --pooling {self.pooling}"
            raise CycloptsError(msg=words) from error

    def _own(self) -> dict[str, Any]:
        return {name: getattr(self, name) for name in ("segments", "lobes", "ambient", "coated")}


def _others(own: dict[str, Any]) -> list[str]:
    """Given options that the painting's one lobe does not have."""
    return fit_kind("torrance-sparrow", "painting").idle(own)


def _everywhere(name: str, kinds: list[FitKind]) -> bool:
    return all(name in kind.defaults for kind in kinds)


def _dashed(own: dict[str, Any]) -> str:
    """What is wrong with options that no fit has together."""
    named = [f"--{name}" for name, value in own.items() if value is not None]
    return f"{' and '.join(named)}: no fit has them together; leave one out"


def _in_words(kind: FitKind) -> str:
    """``--pooling pixel``."""
    return "--{} {}".format(*kind.chosen)


def with_labels(
    options: dict[str, Any], stack: Stack, region: tuple[int, int, int, int] | None
) -> dict[str, Any]:
    """The options, with the picture of segments read from its file."""
    path = options.get("segments")
    return options if path is None else options | {"segments": _labels(path, stack, region)}


def _labels(path: Path, stack: Stack, region: tuple[int, int, int, int] | None) -> NDArray[Any]:
    """The segments of a picture, in the pixels of the photographs."""
    from impasto.io import read_labels

    labels, size = read_labels(path), stack.shape[2:]
    rows, columns = labels.shape
    if region is not None:
        top, left, height, width = region
        labels = labels[top : top + height, left : left + width]
    if labels.shape != size:
        where = "" if region is None else " before --region is applied to both"
        raise ArgumentError(
            f"--segments: {path} has {columns} x {rows} pixels, the photographs "
            f"{size[1]} x {size[0]}; both must have the same size{where}"
        )
    return labels
