"""A list of settings swept over one stack."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from impasto.effort import Effort
from impasto.errors import ArgumentError
from impasto.stack import Stack, checked_stack
from impasto.study.pareto_front import pareto_front
from impasto.study.suggestion import SETTINGS, VIEW_SETTINGS, Suggestion, check_limits, chosen
from impasto.study.table import text
from impasto.study.trials import Advance, Setting, Trial, has_many_views, tried

MORE_SETTINGS: tuple[Setting, ...] = (
    {"pooling": "painting", "effort": "draft"},
    {"pooling": "painting", "effort": "reference"},
    {"pooling": "pixel", "lobes": 1},
    {"pooling": "pixel", "lobes": 3},
    {"pooling": "pixel", "ambient": False},
    {"pooling": "pixel", "normals": "least-squares"},
    {"pooling": "pixel", "effort": Effort(rounds=0, iterations=2)},
    {"pooling": "pixel", "effort": Effort(rounds=1, iterations=6)},
    {"pooling": "pixel", "effort": Effort(rounds=4, iterations=10)},
)
"""What is swept besides the settings of a suggestion: one option or effort changed at a time."""

MORE_VIEW_SETTINGS: tuple[Setting, ...] = (
    {"model": "lafortune", "lobes": 1},
    {"model": "lafortune", "lobes": 2},
)
"""The same where the photographs have more than one view."""


@dataclass(frozen=True, slots=True)
class Study:
    """What :func:`run` measured.

    Attributes
    ----------
    shape
        ``(obs, band, y, x)`` of the stack.
    trials
        Every setting with its error and predicted time, the fastest first.
    suggestion
        The setting to take for the given limits.
    """

    shape: tuple[int, int, int, int]
    trials: tuple[Trial, ...]
    suggestion: Suggestion

    @property
    def front(self) -> tuple[Trial, ...]:
        """The Pareto front: trials that no other beats in both time and error."""
        points = [(trial.seconds, trial.error) for trial in self.trials]
        return tuple(self.trials[index] for index in pareto_front(points))

    def __str__(self) -> str:
        return f"{text(self.trials, self.front)}\n\n{self.suggestion}"


def run(
    stack: Stack,
    *,
    settings: Sequence[Setting] | None = None,
    error: float | None = None,
    seconds: float | None = None,
    threads: int | None = None,
    advance: Advance | None = None,
) -> Study:
    """Try settings of :func:`impasto.fit_sbrdf` on a small part of a stack.

    Each setting is fitted to about four thousand pixels with one photograph in six held out, in
    several folds, as :func:`impasto.suggest_effort` does. Times are predictions for the whole
    stack on this machine.

    Parameters
    ----------
    stack
        At least eight photographs.
    settings
        Options of :func:`impasto.fit_sbrdf`, one dictionary per setting. None: all presets with
        one pooled lobe and with lobes per pixel, other numbers of lobes, no ambient light,
        normals from least squares, and a few other efforts; with more than one view also
        Lafortune lobes.
    error, seconds
        The limits, as in :func:`impasto.suggest_effort`. With neither, the suggestion is the
        fastest setting whose error is within three per cent of the least.
    threads
        Threads of the fits; None: every allowed core.
    advance
        Called as ``advance(done, total)`` after each setting.

    Returns
    -------
    Study
        ``print`` shows its table and its suggestion.

    Raises
    ------
    ArgumentError
        An empty list of settings, an option that :func:`impasto.fit_sbrdf` refuses, or what
        :func:`impasto.suggest_effort` refuses.
    GeometryError
        In no fold can the remaining lights determine normals.
    """
    check_limits(error, seconds)
    checked_stack(stack)
    if settings is None:
        settings = SETTINGS + MORE_SETTINGS
        if has_many_views(stack):
            settings += VIEW_SETTINGS + MORE_VIEW_SETTINGS
    if not settings:
        raise ArgumentError("settings: expected at least one dictionary of options, found none")
    trials = tried(stack, settings, threads=threads, advance=advance)
    suggestion = chosen(trials, error=error, seconds=seconds)
    return Study(stack.shape, suggestion.tried, suggestion)
