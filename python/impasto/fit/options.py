"""Which option belongs to which fit: one table for ``fit_sbrdf`` and the command line."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal, get_args

from impasto._internal.checks import one_of
from impasto.errors import ArgumentError

Model = Literal["torrance-sparrow", "lafortune"]
Pooling = Literal["auto", "none", "painting", "segment", "pixel"]


@dataclass(frozen=True)
class FitKind:
    """One of the fits of :func:`impasto.fit_sbrdf`.

    Attributes
    ----------
    model, pooling
        What is fitted, and to what.
    selected_by
        Which of these two arguments selects it.
    defaults
        Its own options with their default values.
    """

    model: Model
    pooling: Literal["none", "painting", "segment", "pixel"]
    selected_by: Literal["model", "pooling"]
    defaults: Mapping[str, Any]

    @property
    def chosen(self) -> tuple[str, str]:
        """The argument that selects it, and its value."""
        return self.selected_by, getattr(self, self.selected_by)

    def idle(self, given: Mapping[str, Any]) -> list[str]:
        """The given options that belong to other fits; None means not given."""
        return [
            name for name, value in given.items() if name not in self.defaults and value is not None
        ]

    def complete(self, given: Mapping[str, Any]) -> dict[str, Any]:
        """Its own options, with their defaults where None is given.

        Raises
        ------
        ArgumentError
            An option of another fit.
        """
        for name in self.idle(given):
            value = given[name]
            plain = isinstance(value, bool | int | float | str)
            others = " or ".join(_in_python(other) for other in takers(name))
            raise ArgumentError(
                f"{name}: {_in_python(self)} has no such option, found "
                f"{repr(value) if plain else type(value).__name__}; leave it out, or ask for "
                f"{others}"
            )
        return {
            name: default if given.get(name) is None else given[name]
            for name, default in self.defaults.items()
        }


_POOLED = {"extraction": "residual", "peak": False, "joint": True, "index": 1.45}

KINDS = (
    FitKind("torrance-sparrow", "none", "pooling", {}),
    FitKind("torrance-sparrow", "painting", "pooling", _POOLED | {"coated": False}),
    FitKind("torrance-sparrow", "segment", "pooling", {"segments": None} | _POOLED),
    FitKind(
        "torrance-sparrow",
        "pixel",
        "pooling",
        {"lobes": 2, "ambient": True, "index": 1.45, "coated": False},
    ),
    FitKind("lafortune", "pixel", "model", {"lobes": 3}),
)
"""Every fit there is. Normals, effort, threads and progress are options of all of them."""


def fit_kind(model: Model, pooling: Pooling) -> FitKind:
    """The fit of a model and a pooling that is not ``"auto"``.

    Raises
    ------
    ArgumentError
        An unknown name, or a model that has no such pooling.
    """
    one_of(model, get_args(Model), "model")
    one_of(pooling, get_args(Pooling), "pooling")
    kinds = {kind.pooling: kind for kind in KINDS if kind.model == model}
    if pooling not in kinds:
        known = " or ".join(map(repr, ("auto", *kinds)))
        raise ArgumentError(f"pooling: model={model!r} goes with {known} only, found {pooling!r}")
    return kinds[pooling]


def fit_kinds(model: Model, pooling: Pooling, given: Mapping[str, Any]) -> list[FitKind]:
    """The fits among which ``pooling`` leaves the choice.

    ``"auto"`` leaves those that have every given option (None means not given); segments, which
    nobody but the caller knows, must be given.

    Raises
    ------
    ArgumentError
        As :func:`fit_kind`, or options that no fit has together.
    """
    one_of(model, get_args(Model), "model")
    if pooling != "auto":
        return [fit_kind(model, pooling)]
    kinds = [kind for kind in KINDS if kind.model == model]
    if given.get("segments") is None:
        kinds = [kind for kind in kinds if kind.pooling != "segment"]
    left = [kind for kind in kinds if not kind.idle(given)]
    if left:
        return left
    if len(kinds) == 1:
        kinds[0].complete(given)
    named = [name for name, value in given.items() if value is not None]
    raise ArgumentError(f"{' and '.join(named)}: no fit has both; leave one of them out")


def takers(option: str) -> list[FitKind]:
    """Every fit that has an option."""
    return [kind for kind in KINDS if option in kind.defaults]


def _in_python(kind: FitKind) -> str:
    """``pooling='pixel'``."""
    argument, value = kind.chosen
    return f"{argument}={value!r}"
