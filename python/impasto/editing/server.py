"""The page on which marks, balls and meshes are edited."""

from __future__ import annotations

from impasto.local_page import Page, PageServer, Subject

PAGE = Page(
    "impasto.editing",
    ("page.html", "style.css", "main.js", "editor.js", "marks.js", "balls.js", "mesh.js"),
)


class EditServer(PageServer):
    """Serve the page for one subject.

    Parameters
    ----------
    subject
        What is edited.
    port
        To listen on; 0: a free one.

    Raises
    ------
    ArgumentError
        A port that is in use or not allowed.
    """

    def __init__(self, subject: Subject, port: int = 0) -> None:
        super().__init__(subject, PAGE, port)
