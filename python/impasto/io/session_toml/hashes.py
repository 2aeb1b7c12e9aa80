"""Files of a session: inside its folder, there, and with the SHA-256 that it states."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

from impasto._internal.regular import check_regular, unreadable
from impasto.errors import ArgumentError, CorruptInputError
from impasto.io.notes import few
from impasto.io.session_toml.schema import Session

_KEPT = 1 << 14
"""Files whose hash is remembered until they change: a stack may be read region by region."""


@dataclass(frozen=True, slots=True)
class Problem:
    """A listed file that is not as the session says.

    Parameters
    ----------
    name
        As written in the session.
    path
        The file.
    found
        Its SHA-256; empty where there is no such file.
    line
        Of the session file, from 1 on; 0: unknown.
    """

    name: str
    path: Path
    found: str
    line: int


def root(session: Session) -> Path:
    """The folder from which names of files start.

    Raises
    ------
    ArgumentError
        A session that was not read from a file.
    """
    if session.path is None:
        raise ArgumentError("session: has no path; write it first, and read it again")
    return session.path.parent


def confined(session: Session, path: Path, key: str) -> Path:
    """The path, if it lies inside the session's folder or may lie outside.

    Links are followed for this.

    Raises
    ------
    ArgumentError
        It leads outside, or nowhere.
    """
    if session.allow_outside:
        return path
    try:
        whole, target = root(session).resolve(), path.resolve()
    except (OSError, RuntimeError, ValueError) as error:  # circles of links, NUL, too long
        raise ArgumentError(f"{session.place(key)}: {path} cannot be followed ({error})") from error
    if not target.is_relative_to(whole):
        raise ArgumentError(
            f"{session.place(key)}: {path} leads outside the folder of the session, to {target}; "
            "move the file inside, or write allow_outside = true at the top of the session file"
        )
    return path


def problems(session: Session) -> Iterator[Problem]:
    """Every listed file that is missing or another one; all of them are read."""
    for name, digest in session.sha256.items():
        path = confined(session, root(session) / name, f"files.{name}")
        line = session.lines.get(f"files.{name}", 0)
        try:
            there = path.is_file()
        except (OSError, ValueError):
            there = False
        found = sha256_of(path) if there else ""
        if found != digest:
            yield Problem(name, path, found, line)


def verify(session: Session) -> None:
    """Compare all listed files with their hashes.

    Raises
    ------
    ArgumentError
        A listed file is missing.
    CorruptInputError
        A file is another one than was listed; the message says how to accept it.
    """
    found = list(problems(session))
    if not found:
        return
    first, others = found[0], [problem.name for problem in found[1:]]
    more = f"; changed or missing, too: {few(others)}" if others else ""
    where = session.place(f"files.{first.name}")
    if not first.found:
        raise ArgumentError(
            f"{where}: is missing{more}; put it back, or remove the line if the session goes "
            "without it (impasto session check lists all)"
        )
    raise CorruptInputError(
        first.path,
        f"is another file than when the session was written{more} ({where} has another SHA-256); "
        f'copy it again, or, if the change is meant, write "{first.found}" in that line '
        "(impasto session check lists all)",
    )


def unlisted(session: Session, paths: Iterable[Path]) -> list[str]:
    """Names of the files among ``paths`` of which the session states no SHA-256."""
    folder = root(session)
    known = {Path(os.path.normpath(folder / name)) for name in session.sha256}
    return [path.name for path in paths if Path(os.path.normpath(path)) not in known]


def sha256_of(path: Path) -> str:
    """The SHA-256 of a file, as 64 hexadecimal digits; remembered until the file changes.

    Raises
    ------
    ArgumentError
        It cannot be read.
    """
    check_regular(path)
    try:
        found = path.stat()
        return _digest(str(path), found.st_size, found.st_mtime_ns, found.st_ino)
    except OSError as error:
        raise unreadable(path, error) from error


@lru_cache(maxsize=_KEPT)
def _digest(path: str, size: int, time_ns: int, number: int) -> str:
    """``size``, ``time_ns`` and ``number`` change with the file: they are a part of the key."""
    with Path(path).open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
