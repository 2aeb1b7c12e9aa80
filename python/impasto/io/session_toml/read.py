"""Read ``session.toml``: strictly, with file, line and key in every message."""

from __future__ import annotations

import json
import re
import tomllib
from contextlib import closing
from pathlib import Path
from typing import Any

from impasto._internal.checks import suggestion
from impasto._internal.damage import damage_of
from impasto._internal.regular import RegularFile
from impasto.errors import ArgumentError, CorruptInputError
from impasto.io.session_toml.schema import KEYS, TABLES, VERSION, Key, Session

SESSION_FILE = "session.toml"
"""Its name in a folder."""
_LARGEST = 1 << 24
"""Bytes; 100 000 photographs have 10 MB of hashes."""
_HEADER = re.compile(r"\s*\[\s*([^\[\]]+?)\s*\]")
_KEY = re.compile(r"""\s*("(?:[^"\\]|\\.)*"|'[^']*'|[\w.-]+)\s*=""")
_BY_NAME = {key.name: key for key in KEYS}
_SECTIONS = {name.split(".")[0] for name in _BY_NAME if "." in name}


def is_session(path: Path) -> bool:
    """Whether a path is that of a session file, or a folder with one."""
    if path.suffix.lower() == ".toml":
        return not path.is_dir()
    return path.is_dir() and (path / SESSION_FILE).is_file()


def read_session(path: str | Path) -> Session:
    """Read a session file; the files that it names are not opened.

    Parameters
    ----------
    path
        The file, or a folder with a ``session.toml``.

    Returns
    -------
    Session
        All values, checked; names of files as written.

    Raises
    ------
    CorruptInputError
        No TOML.
    ArgumentError
        Not found, an unknown key, a value of the wrong kind, keys that exclude each other, or a
        later version of the format. The message has file, line and key.
    """
    path = Path(path)
    if path.is_dir():
        path = path / SESSION_FILE
    return parse_session(_text(path), path)


def parse_session(text: str, path: Path) -> Session:
    """As :func:`read_session`, of the contents of a file."""
    with damage_of(path, "TOML"):
        content = tomllib.loads(text)
    session = Session(path=path, lines=_lines(text))
    _check_version(session, content.pop("version", None))
    found = _flattened(session, content)
    values: dict[str, Any] = {}
    for name, value in found.items():
        key = _BY_NAME[name]
        try:
            values[key.attribute] = key.check(value)
        except ValueError as error:
            raise ArgumentError(f"{_place(session, key, value)}: {error}") from error
    session = Session(path=path, lines=session.lines, **values)
    _check_lights(session)
    return session


def _text(path: Path) -> str:
    with closing(RegularFile(path)) as file:
        if file.size > _LARGEST:
            raise CorruptInputError(path, f"has {file.size} bytes: too large for a session file")
        data = file.content()
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise CorruptInputError(path, f"is not UTF-8, as TOML must be ({error.reason})") from error


def _check_version(session: Session, version: Any) -> None:
    if version is None:
        raise ArgumentError(
            f"{session.path}: has no version; is this a session file of impasto? It begins with "
            f"version = {VERSION}"
        )
    if isinstance(version, bool) or version != VERSION:
        shown = str(version)[:40]
        raise ArgumentError(
            f"{session.place('version')}: expected {VERSION}, found {shown}; a later format needs "
            "a later impasto"
        )


def _flattened(session: Session, content: dict[str, Any]) -> dict[str, Any]:
    """Values by their full names; sections with a line for each file stay whole."""
    found: dict[str, Any] = {}
    for name, value in content.items():
        if name not in _SECTIONS:
            _known(session, name)
            found[name] = value
            continue
        if not isinstance(value, dict):
            raise ArgumentError(f"{session.place(name)}: is a section, [{name}], not a value")
        for inner, one in value.items():
            full = f"{name}.{inner}"
            _known(session, full)
            found[full] = one
    return found


def _known(session: Session, name: str) -> None:
    if name in _BY_NAME:
        return
    last = name.rpartition(".")[2]
    elsewhere = [full for full in _BY_NAME if full.rpartition(".")[2] == last]
    near = f"; did you mean {elsewhere[0]!r}?" if elsewhere else suggestion(name, _BY_NAME)
    raise ArgumentError(
        f"{session.place(name)}: is no key of a session file{near or '; remove the line'}"
    )


def _place(session: Session, key: Key, value: Any) -> str:
    """Of a section the line that is wrong."""
    if key.name in TABLES and isinstance(value, dict):
        for name, one in value.items():
            try:
                key.check({name: one})
            except ValueError:
                return session.place(f"{key.name}.{name}")
    return session.place(key.name)


def _check_lights(session: Session) -> None:
    ways = {
        "lights.file": session.lights,
        "lights.directions": session.directions,
        "lights.positions_mm": session.positions_mm,
    }
    given = [name for name, value in ways.items() if value is not None]
    if len(given) > 1:
        raise ArgumentError(
            f"{session.place(given[1])}: {given[0]} says where the lights are, too; keep one"
        )
    if session.views is None:
        return
    lamps = session.directions if session.positions_mm is None else session.positions_mm
    if lamps is None:
        raise ArgumentError(
            f"{session.place('lights.views')}: needs lights.directions or lights.positions_mm; a "
            "light file with views is a .csv"
        )
    if odd := [*(lamps.keys() ^ session.views.keys())]:
        raise ArgumentError(
            f"{session.place('lights.views')}: {min(odd)!r} has a light or a view, but not both"
        )


def _lines(text: str) -> dict[str, int]:
    """The line of each key, from 1 on; lines within long texts may look like keys."""
    found: dict[str, int] = {}
    section = ""
    for number, line in enumerate(text.splitlines(), 1):
        if header := _HEADER.match(line):
            section = f"{header[1]}."
            found.setdefault(header[1], number)
        elif key := _KEY.match(line):
            found.setdefault(section + _unquoted(key[1]), number)
    return found


def _unquoted(key: str) -> str:
    if key.startswith("'"):
        return key[1:-1]
    if key.startswith('"'):
        try:
            return str(json.loads(key))
        except ValueError:  # an escape that JSON does not have
            return key[1:-1]
    return key
