"""Which option belongs to which fit: one table for ``fit_sbrdf`` and the command line."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal, get_args

from impasto._internal.checks import one_of
from impasto.errors import ArgumentError

Model = Literal["torrance-sparrow", "lafortune"]
Pooling = Literal["painting", "segment", "pixel"]


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
    pooling: Pooling
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


_POOLED = {"extraction": "residual", "joint": True, "index": 1.45}

KINDS = (
    FitKind("torrance-sparrow", "painting", "pooling", _POOLED),
    FitKind("torrance-sparrow", "segment", "pooling", {"segments": None} | _POOLED),
    FitKind("torrance-sparrow", "pixel", "pooling", {"lobes": 2, "ambient": True, "index": 1.45}),
    FitKind("lafortune", "pixel", "model", {"lobes": 3}),
)
"""Every fit there is. Normals, effort, threads and progress are options of all of them."""

_POOLING: Mapping[Model, Pooling] = {"torrance-sparrow": "painting", "lafortune": "pixel"}
"""How a model's lobes are pooled by default."""


def fit_kind(model: Model, pooling: Pooling | None) -> FitKind:
    """The fit of a model and a pooling.

    Raises
    ------
    ArgumentError
        An unknown name, or a model that has no such pooling.
    """
    one_of(model, get_args(Model), "model")
    wanted = _POOLING[model] if pooling is None else pooling
    one_of(wanted, get_args(Pooling), "pooling")
    kinds = {kind.pooling: kind for kind in KINDS if kind.model == model}
    if wanted not in kinds:
        known = " or ".join(map(repr, kinds))
        raise ArgumentError(f"pooling: model={model!r} goes with {known} only, found {wanted!r}")
    return kinds[wanted]


def takers(option: str) -> list[FitKind]:
    """Every fit that has an option."""
    return [kind for kind in KINDS if option in kind.defaults]


def _in_python(kind: FitKind) -> str:
    """``pooling='pixel'``."""
    argument, value = kind.chosen
    return f"{argument}={value!r}"
