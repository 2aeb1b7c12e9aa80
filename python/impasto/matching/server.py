"""The page of the matching experiment, for one session on this machine."""

from __future__ import annotations

from impasto.local_page import Page, PageServer
from impasto.matching.experiment import Experiment

PAGE = Page("impasto.matching", ("page.html", "style.css", "main.js"))


class MatchingServer(PageServer):
    """Serve the page.

    Parameters
    ----------
    experiment
        The session.
    port
        To listen on; 0: a free one.

    Raises
    ------
    ArgumentError
        A port that is in use or not allowed.
    """

    def __init__(self, experiment: Experiment, port: int = 0) -> None:
        super().__init__(experiment, PAGE, port)
