"""What the page may load: its own files, nothing from another host."""

from __future__ import annotations


def policy(*, embedded: bool) -> str:
    """The Content-Security-Policy of the page.

    Parameters
    ----------
    embedded
        For a ``meta`` element of a page that may be opened as ``file://``; otherwise for the header
        of an answer, which can forbid more.
    """
    own = "'self' file:" if embedded else "'self'"
    parts = [
        "default-src 'none'",
        f"script-src {own}",
        f"style-src {own}",
        f"img-src {own} data: blob:",
        "base-uri 'none'",
        "form-action 'none'",
    ]
    return "; ".join(parts if embedded else [*parts, "frame-ancestors 'none'"])
