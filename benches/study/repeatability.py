"""Repeatability of a study: errors bit for bit, costs in their ratios."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations
from typing import Any

import numpy as np

from impasto.errors import ArgumentError
from study.candidates import Row
from study.journal import CLOCKS, TERMS, key_of

TENTH = 0.1
"""Allowed difference of the ratio of two costs between runs."""


def check_alike(first: dict[str, Any], second: dict[str, Any]) -> None:
    """Refuse to compare two studies that differ in code, data, machine or options."""
    for term in (*TERMS, *CLOCKS):
        one, other = first.get(term), second.get(term)
        if one != other:
            raise ArgumentError(f"second: another study ({term} {other!r}, recorded {one!r})")


def beside(first: dict[str, Any], second: dict[str, Any]) -> list[Row]:
    """Rows of a study, each with the result of a second run under ``again``.

    Parameters
    ----------
    first, second
        What :func:`study.run` returned, in two processes.

    Returns
    -------
    list
        Rows of ``first``; ``again`` holds the second run's cost and doubt, and whether its errors
        are the ``same`` bit for bit. A row that the second run has not has no ``again``.

    Raises
    ------
    ArgumentError
        They are runs of two studies: of other code, data, seed, threads, or on another machine.
    """
    check_alike(first["run"], second["run"])
    found = {key_of(row): row for row in second["rows"]}
    rows = []
    for row in first["rows"]:
        bare = {name: value for name, value in row.items() if name != "again"}
        if (other := found.get(key_of(row))) is not None:
            same = other["error"] == row["error"]
            bare["again"] = {"cost": other["cost"], "doubt": other["doubt"], "same": same}
        rows.append(bare)
    return rows


def apart(rows: Sequence[Row]) -> tuple[list[float], list[float]]:
    """Relative differences of the costs of two runs, in ascending order.

    Returns
    -------
    tuple
        Every fit in proportion to all others (their median); and the ratio of every two fits of a
        data set.
    """
    logs = [np.log(row["again"]["cost"]["cpu"] / row["cost"]["cpu"]) for row in rows]
    middle = np.median(logs)
    by_data: dict[str, list[float]] = {}
    for row, log in zip(rows, logs, strict=True):
        by_data.setdefault(row["data"], []).append(float(log))
    pairs = [a - b for some in by_data.values() for a, b in combinations(some, 2)]
    return _shares(logs - middle), _shares(np.array(pairs))


def kept(rows: Sequence[Row]) -> bool:
    """Whether two runs have the same errors and costs whose ratios agree within a tenth."""
    same = all(row.get("again", {}).get("same", False) for row in rows)
    return same and apart(rows)[0][-1] <= TENTH


def _shares(logs: Any) -> list[float]:
    return sorted(np.expm1(np.abs(logs)).tolist())
