"""Write ``session.toml`` for people: every key with its meaning, unknown ones as comments.

TOML has no writer in Python's library; this one writes texts, numbers, lists and sections.
"""

from __future__ import annotations

import json
import textwrap
from collections.abc import Iterator, Mapping
from numbers import Integral, Real
from pathlib import Path
from typing import Any

from impasto.errors import ArgumentError
from impasto.io.files import atomic_bytes
from impasto.io.session_toml.read import parse_session
from impasto.io.session_toml.schema import KEYS, TABLES, VERSION, Key, Session

_WIDTH = 98
_HEAD = (
    "# The photographs of one painting, for impasto: read_stack, impasto fit, doctor, job run.",
    "# Names of files start from the folder of this file. A line that begins with # is a comment:",
    "# remove the # from a key to give it a value.",
)


def write_session(path: str | Path, session: Session) -> None:
    """Write a session file that reads back to the same values.

    Parameters
    ----------
    path
        A new file, ``session.toml`` in the folder of the session.
    session
        What to write; keys without a value become comments with an example.

    Raises
    ------
    ArgumentError
        The file exists, a value is not what :func:`~impasto.io.read_session` accepts, or a name has
        characters that no TOML file can hold.
    """
    path = Path(path)
    if path.exists():
        raise ArgumentError(f"path: {path} already exists and is not replaced")
    text = session_text(session)
    parse_session(text, path)
    try:
        data = text.encode("utf-8")
    except UnicodeEncodeError as error:
        raise ArgumentError(
            "session: a name has characters that no TOML file can hold "
            f"({error.object[max(0, error.start - 20) : error.end + 20]!r}); rename that file"
        ) from error
    atomic_bytes(path, data)


def session_text(session: Session) -> str:
    """The contents of the file."""
    lines = [*_HEAD, f"version = {VERSION}"]
    section = ""
    for key in KEYS:
        head = key.name if key.name in TABLES else key.name.rpartition(".")[0]
        value = getattr(session, key.attribute)
        if key.name in TABLES:
            lines += ["", *_comment(key), *_table(key, value)]
            continue
        if head != section:
            lines += ["", f"[{head}]"]
            section = head
        lines += [*_comment(key), _line(key, value)]
    return "\n".join(lines) + "\n"


def _comment(key: Key) -> Iterator[str]:
    yield from textwrap.wrap(
        key.meaning, _WIDTH, initial_indent="# ", subsequent_indent="# ", break_on_hyphens=False
    )


def _line(key: Key, value: Any) -> str:
    name = key.name.rpartition(".")[2]
    return f"# {name} = {key.example}" if value is None else f"{name} = {toml(value)}"


def _table(key: Key, value: Mapping[str, Any] | None) -> Iterator[str]:
    if not value:
        yield from (f"# [{key.name}]", f"# {key.example}")
        return
    yield f"[{key.name}]"
    for name, one in value.items():
        yield f"{toml(name)} = {toml(one)}"


def toml(value: Any) -> str:
    """A text, number, truth value or list as TOML.

    The escapes of JSON are those of TOML, which forbids one more character.

    Raises
    ------
    ArgumentError
        A value of another kind.
    """
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(value, tuple | list):
        return f"[{', '.join(map(toml, value))}]"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, Integral):
        return str(int(value))
    if isinstance(value, Real):
        return repr(float(value))
    raise ArgumentError(f"session: expected texts and numbers, found {type(value).__name__}")
