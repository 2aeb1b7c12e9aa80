"""Accuracy against time, measured on your own photographs.

:func:`run` fits a small part of a stack with a list of settings, compares each fit with photographs
that it has not seen, and returns a :class:`Study`: errors, predicted times, the Pareto front and a
suggestion. :func:`write` saves it. ``impasto study`` is the command. :func:`impasto.suggest_effort`
asks the same question with five settings.

The study behind the documentation, on fixed data and beside other programs, is in
``benches/study`` of the repository.
"""

from impasto.study.report import write
from impasto.study.sweep import Study, run
from impasto.study.trials import Trial

__all__ = ["Study", "Trial", "run", "write"]
