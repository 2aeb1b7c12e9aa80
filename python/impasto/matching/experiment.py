"""A session: which picture comes when, what is chosen, and where a killed session goes on."""

from __future__ import annotations

import zlib
from pathlib import Path
from typing import Any

import numpy as np

from impasto._internal.checks import is_whole, number
from impasto._internal.png import png
from impasto.errors import ArgumentError
from impasto.matching.log import Choice, LogWriter, MatchingLog
from impasto.matching.stimuli import Stimuli

ADAPTATION_S = 180.0
"""Seconds that observers look at the painting first: the three minutes of the paper."""
LONGEST_S = 3600.0
MOST_TRIALS = 200


class Experiment:
    """What the page shows: one trial after another, each with all pictures in a random order.

    The page never learns which picture has which degree: it asks for the picture at a position.

    Parameters
    ----------
    stimuli
        The pictures.
    log
        The file of the session; a session that was interrupted goes on where it stopped.
    observer
        Who looks.
    painting
        What they look at; sessions with two paintings are compared.
    trials
        Matches to make; default: 4.
    seed
        Of the orders; they also depend on the observer.
    adapt_seconds
        Before the first match of a sitting; default: 180, as in the paper.

    Raises
    ------
    ArgumentError
        Numbers out of range, an observer without a name, a log of another session.
    CorruptInputError
        A damaged log.
    """

    def __init__(
        self,
        stimuli: Stimuli,
        log: str | Path,
        *,
        observer: str,
        painting: str,
        trials: int = 4,
        seed: int = 0,
        adapt_seconds: float = ADAPTATION_S,
    ) -> None:
        if not (isinstance(observer, str) and observer.strip()):
            raise ArgumentError(f"observer: expected a name, found {observer!r}")
        if not (is_whole(trials) and 1 <= trials <= MOST_TRIALS):
            raise ArgumentError(f"trials: expected 1 to {MOST_TRIALS}, found {trials!r}")
        if not (is_whole(seed) and 0 <= seed < 2**32):
            raise ArgumentError(f"seed: expected a whole number from 0 on, found {seed!r}")
        wait = number(adapt_seconds, "adapt_seconds", f"0 to {LONGEST_S:g} seconds")
        if not 0.0 <= wait <= LONGEST_S:
            raise ArgumentError(f"adapt_seconds: expected 0 to {LONGEST_S:g}, found {wait:g}")
        self.stimuli = stimuli
        self.settings: dict[str, Any] = {
            "observer": observer.strip(),
            "painting": painting,
            "trials": int(trials),
            "seed": int(seed),
            "adapt_seconds": wait,
            "degrees": list(stimuli.degrees),
            "illuminant": stimuli.illuminant,
            "reference": stimuli.reference,
            "mode": stimuli.mode,
            "display": stimuli.display,
            "key": stimuli.key,
            "xyz": stimuli.xyz.tolist(),
        }
        self._writer = LogWriter(Path(log), self.settings)
        self._png: dict[int, bytes] = {}

    @property
    def log(self) -> MatchingLog:
        """All choices so far."""
        return self._writer.log

    @property
    def trial(self) -> int:
        """The number of the trial that is under way; that of all trials when none is left."""
        return len(self.log.choices)

    def order(self, trial: int) -> list[int]:
        """Numbers of the pictures by their positions in a trial."""
        observer = zlib.crc32(self.log.observer.encode())
        random = np.random.default_rng([self.settings["seed"], observer, trial])
        return [int(one) for one in random.permutation(len(self.stimuli.degrees))]

    def document(self) -> dict[str, Any]:
        """What the page needs to know; no degree is in it."""
        return {
            "kind": "matching",
            "trial": self.trial,
            "trials": self.log.trials,
            "pictures": len(self.stimuli.degrees),
            "adapt_seconds": self.settings["adapt_seconds"],
            "illuminant": str(self.stimuli.illuminant),
        }

    def picture(self, position: int) -> bytes:
        """The picture at a position of the trial that is under way, as PNG.

        Raises
        ------
        IndexError
            No position, or no trial is left.
        """
        if self.trial >= self.log.trials:
            raise IndexError("all trials are done")
        which = self.order(self.trial)[position]
        if which not in self._png:
            self._png[which] = png(self.stimuli.pictures[which])
        return self._png[which]

    def tile(self, number: int, column: int, row: int) -> bytes:
        """There are none.

        Raises
        ------
        IndexError
            Always.
        """
        raise IndexError("pictures have no tiles")

    def save(self, content: dict[str, Any]) -> str:
        """Take the choice of a trial, and write it.

        Parameters
        ----------
        content
            ``trial``, ``position``, ``steps`` and ``seconds``.

        Raises
        ------
        ArgumentError
            Another trial than the one under way, as from a page that was left open, or no position.
        """
        trial, position = content.get("trial"), content.get("position")
        if trial != self.trial or self.trial >= self.log.trials:
            raise ArgumentError(
                f"trial: expected {self.trial} of {self.log.trials}, found {trial!r}; reload the "
                "page"
            )
        order = self.order(self.trial)
        if not (is_whole(position) and 0 <= position < len(order)):
            raise ArgumentError(
                f"position: expected 0 to {len(order) - 1}, found {content.get('position')!r}"
            )
        steps, seconds = content.get("steps"), content.get("seconds")
        if not (is_whole(steps) and 1 <= steps <= 1_000_000):
            raise ArgumentError(f"steps: expected a whole number from 1 on, found {steps!r}")
        spent = number(seconds, "seconds", "seconds from 0 on")
        if not 0.0 <= spent <= 1e6:
            raise ArgumentError(f"seconds: expected seconds from 0 on, found {seconds!r}")
        degree = self.stimuli.degrees[order[position]]
        self._writer.commit(Choice(self.trial, degree, int(steps), round(spent, 3)))
        return f"{self.trial} of {self.log.trials}"

    def close(self) -> None:
        """Give the log back."""
        self._writer.close()
