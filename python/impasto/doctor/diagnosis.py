"""The result of an examination: findings with their severity."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Literal, TypeAlias, get_args

from impasto._internal.wording import counted

Severity: TypeAlias = Literal["ok", "note", "warning", "error"]
SEVERITIES: tuple[Severity, ...] = get_args(Severity)
"""In increasing order."""

_WIDTH = 92
_INDENT = " " * 10


@dataclass(frozen=True, slots=True)
class Finding:
    """One check and its result.

    Parameters
    ----------
    code
        A short stable name for programs; ``docs/doctor.md`` and ``docs/session.md`` list them.
    severity
        ``"ok"``: no fault, or the photographs cannot show whether there is one; ``"note"``: for
        information; ``"warning"``: results will be worse than they could be; ``"error"``: results
        would be wrong or impossible.
    message
        What was found, with numbers; angles in degrees.
    advice
        What to do; empty if there is nothing to do.
    observations
        Indices of the photographs concerned; empty for all of them.
    numbers
        The measurements behind the message.
    """

    code: str
    severity: Severity
    message: str
    advice: str = ""
    observations: tuple[int, ...] = ()
    numbers: dict[str, Any] = field(default_factory=dict)

    def __str__(self) -> str:
        first = textwrap.fill(
            f"{self.code}: {self.message}",
            _WIDTH,
            initial_indent=f"{self.severity:<{len(_INDENT)}}",
            subsequent_indent=_INDENT,
            break_on_hyphens=False,
        )
        if not self.advice:
            return first
        second = textwrap.fill(
            self.advice,
            _WIDTH,
            initial_indent=f"{_INDENT}-> ",
            subsequent_indent=f"{_INDENT}   ",
            break_on_hyphens=False,
        )
        return f"{first}\n{second}"


@dataclass(frozen=True, eq=False)
class Diagnosis:
    """All findings of an examination; ``print`` shows them, the most severe first.

    Parameters
    ----------
    findings
        In the order of the checks.
    names
        One name per photograph.
    shape
        ``(obs, band, y, x)`` of the stack.
    of_result
        Whether the maps of a fit were examined, not its photographs.
    """

    findings: tuple[Finding, ...]
    names: tuple[str, ...]
    shape: tuple[int, int, int, int]
    of_result: bool = False

    @property
    def worst(self) -> Severity:
        """The highest severity that occurs."""
        return max((f.severity for f in self.findings), key=SEVERITIES.index, default="ok")

    @property
    def usable(self) -> bool:
        """Whether there is no error; warnings are possible."""
        return self.worst != "error"

    def of(self, *severities: Severity) -> tuple[Finding, ...]:
        """The findings of some severities, most severe first, then in order of the checks."""
        picked = [f for f in self.findings if f.severity in severities]
        return tuple(sorted(picked, key=lambda f: -SEVERITIES.index(f.severity)))

    def __getitem__(self, code: str) -> Finding:
        """The most severe finding with a code."""
        found = [f for f in self.findings if f.code == code]
        if not found:
            raise KeyError(f"no finding {code!r}, only {sorted({f.code for f in self.findings})}")
        return max(found, key=lambda f: SEVERITIES.index(f.severity))

    @property
    def title(self) -> str:
        """The size of what was examined, in one line."""
        observations, bands, height, width = self.shape
        return (
            f"{'a fit of ' if self.of_result else ''}{counted(observations, 'photograph')}, "
            f"{counted(bands, 'band')}, {width} x {height} pixels"
        )

    @property
    def verdict(self) -> str:
        """The conclusion, in one sentence."""
        counts = {s: len(self.of(s)) for s in SEVERITIES}
        if counts["error"]:
            repair = (
                "this is no whole result" if self.of_result else "repair the stack before a fit"
            )
            return f"{counted(counts['error'], 'error')}: {repair}"
        if counts["warning"]:
            return f"usable, with {counted(counts['warning'], 'warning')}"
        return "no fault found"

    def to_dict(self) -> dict[str, Any]:
        """Plain values for JSON."""
        return {
            "verdict": self.verdict,
            "worst": self.worst,
            "usable": self.usable,
            "shape": list(self.shape),
            "photographs": list(self.names),
            "findings": [
                {
                    "code": f.code,
                    "severity": f.severity,
                    "message": f.message,
                    "advice": f.advice,
                    "observations": list(f.observations),
                    "numbers": f.numbers,
                }
                for f in self.findings
            ],
        }

    def __str__(self) -> str:
        lines = [self.title, ""]
        lines += [str(finding) for finding in self.of(*SEVERITIES)]
        return "\n".join([*lines, "", self.verdict])

    def __repr__(self) -> str:
        return f"<Diagnosis of {self.title}: {self.verdict}>"


def named(names: Sequence[str], indices: Sequence[int], limit: int = 4) -> str:
    """The first few photographs by name: ``a.jpg, b.jpg and 7 more``."""
    shown = ", ".join(names[i] for i in indices[:limit])
    rest = len(indices) - limit
    return f"{shown} and {rest} more" if rest > 0 else shown
