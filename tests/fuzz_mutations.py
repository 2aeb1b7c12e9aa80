"""Damage to small good files: any of their bytes, values of JSON, members of archives.

Repairs make checksums right again, so that what they protect is reached, too.
"""

from __future__ import annotations

import contextlib
import copy
import json
import random
import zipfile
import zlib
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np

from impasto._internal.damage import DAMAGE
from impasto.io import json_lines
from impasto.io.results import zarr_store

NUMBERS = (0, 1, 2, 3, 7, 8, 127, 255, 256, 32767, 65535, 2**24, 2**31 - 1, 2**31, 2**32 - 1)
WORDS = (
    *(bytes([code]) for code in b'\0\r\n\t"\\,;:# []{}\xff'),
    *(b"nan", b"NaN", b"inf", b"1e999", b"-1e999", b"-1", b"0", b"1e-320", b"1_0", b"0x1f"),
    *(b"null", b"true", b'""', b"[]", b"{}", b"[" * 3000, b'{"a":' * 3000, b"../../x"),
    *(b"\xef\xbb\xbf", b"\xff\xfe", "²".encode(), b"9" * 400, b"9" * 5000, b"a" * 140_000),
)
VALUES: tuple[Any, ...] = (
    *(0, 1, -1, 255, 2**40, 0.5, -1.0, 1e-320, 1e308, float("nan"), float("inf"), True, "", "a"),
    *("9" * 400, "{", "[" * 3000, [], [0.0], [[1.0, 2.0, 3.0]], [["a"]], 1j, b"x"),
)
"""Arrays that nobody expects."""
LEAVES = (
    *(value for value in VALUES if not isinstance(value, complex | bytes)),
    *(None, -0.0, 1e-3, 1e3, 1e9, -1e9, 2**31, 10**400, {}, [[]], [None], [12, 10], "radial"),
    *([0.0] * 3, [1e200] * 3, [[0.0] * 3] * 3, [[1e200] * 3] * 3),
)
"""The same for values of JSON."""


@dataclass(frozen=True)
class Reader:
    """Good files, how to read one, and whether they are text."""

    suffix: str
    seeds: list[bytes]
    read: Callable[[Path], Any]
    text: bool = False
    repair: Callable[[bytes, list[bytes], random.Random], bytes] = lambda data, seeds, chance: data
    """Makes checksums right again, so that what they protect is reached, too."""


def mutated(seeds: list[bytes], chance: random.Random, *, text: bool) -> bytes:
    """One of the good files with one to six changes."""
    data = bytearray(chance.choice(seeds))
    for _ in range(chance.choice((1, 1, 1, 2, 3, 6))):
        at = chance.randrange(len(data) + 1)
        # Headers decide more than pixels do.
        at = min(at, chance.randrange(256)) if chance.random() < 0.3 else at
        end = min(len(data), at + chance.choice((1, 2, 4, 16, 256)))
        kind = chance.randrange(9)
        if kind == 0 and at < len(data):
            data[at] ^= 1 << chance.randrange(8)
        elif kind == 1 and at < len(data):
            data[at] = chance.choice((0, 1, 0x7F, 0x80, 0xFF, chance.randrange(256)))
        elif kind == 2:
            del data[at:end]
        elif kind == 3:
            data[at:at] = data[at:end]
        elif kind == 4:
            del data[at:]
        elif kind == 5:
            size = chance.choice((2, 4, 8))
            number = chance.choice(NUMBERS) % (1 << 8 * size)
            data[at : at + size] = number.to_bytes(size, chance.choice(("little", "big")))
        elif kind == 6:
            other = chance.choice(seeds)
            start = chance.randrange(len(other) + 1)
            data[at:end] = other[start : start + end - at]
        elif kind == 7 and text:
            data[at:at] = chance.choice(WORDS)
        elif kind == 8 and text:
            data[at:end] = chance.choice(WORDS)
        else:
            data[at:end] = bytes(end - at)
    return bytes(data)


def chunks_repaired(data: bytes, seeds: list[bytes], chance: random.Random) -> bytes:
    """Most PNG files with right checksums."""
    found, at = bytearray(data), 8
    while at + 12 <= len(found) and chance.random() < 0.93:
        end = at + 8 + int.from_bytes(found[at : at + 4], "big")
        found[end : end + 4] = zlib.crc32(found[at + 4 : end]).to_bytes(4, "big")
        at = end + 4
    return bytes(found)


def lines_repaired(data: bytes, seeds: list[bytes], chance: random.Random) -> bytes:
    """Most lines of a journal with right checksums, as far as they still are lines."""
    lines = data.splitlines(keepends=True)
    for index, line in enumerate(lines):
        with contextlib.suppress(ValueError, RecursionError):
            content = json.loads(line)
            if isinstance(content, dict) and chance.random() < 0.9:
                content.pop(json_lines.CHECK, None)
                if "before" in content:
                    content["before"] = json_lines.crc_of(b"".join(lines[:index]))
                lines[index] = json_lines.sealed_line(content)
    return b"".join(lines)


def record_repaired(data: bytes, seeds: list[bytes], chance: random.Random) -> bytes:
    """Most records of jobs with a right checksum; half of them whole but for a value or two."""
    if chance.random() < 0.1:
        return data
    with contextlib.suppress(*DAMAGE):
        content = json.loads(data if chance.random() < 0.5 else chance.choice(seeds))
        if chance.random() < 0.8:
            for _ in range(chance.choice((1, 1, 2))):
                _change_leaf(content, chance)
        return _sealed_record(content)
    return data


def moved(record: bytes, folder: str, other: str) -> bytes:
    """The record of a job whose files lie in another folder."""
    return _sealed_record(json.loads(record.decode().replace(folder, other)))


def _sealed_record(content: dict[str, Any]) -> bytes:
    content.pop(json_lines.CHECK, None)
    text = _record_text(content)
    return _record_text(content | {json_lines.CHECK: json_lines.crc_of(text)})


def _record_text(content: dict[str, Any]) -> bytes:
    return (json.dumps(content, indent=2, sort_keys=True) + "\n").encode()


def leaves_changed(data: bytes, seeds: list[bytes], chance: random.Random) -> bytes:
    """Most JSON files whole again, with one to three values that nobody expects."""
    if chance.random() < 0.3:
        return data
    content = json.loads(chance.choice(seeds))
    for _ in range(chance.choice((1, 1, 2, 3))):
        _change_leaf(content, chance)
    return json.dumps(content).encode()


def line_changed(data: bytes, seeds: list[bytes], chance: random.Random) -> bytes:
    """Half of the journals with one value that nobody expects, and right checksums."""
    if chance.random() < 0.5:
        return lines_repaired(data, seeds, chance)
    lines = chance.choice(seeds).splitlines(keepends=True)
    index = chance.randrange(len(lines))
    content = json_lines.opened_line(lines[index])
    _change_leaf(content, chance)
    lines[index] = json_lines.sealed_line(content)
    return b"".join(lines)


def _change_leaf(content: dict[str, Any], chance: random.Random) -> None:
    inside: Any = content
    while inside:
        key = chance.choice(list(inside) if isinstance(inside, dict) else range(len(inside)))
        if isinstance(inside[key], dict | list) and inside[key] and chance.random() < 0.9:
            inside = inside[key]
        elif isinstance(inside, dict) and chance.random() < 0.1:
            del inside[key]
            return
        else:
            inside[key] = copy.deepcopy(chance.choice(LEAVES))
            return


def list_repaired(data: bytes, seeds: list[bytes], chance: random.Random) -> bytes:
    """Most lists of a store's arrays with right checksums, as far as they still are lists."""
    with contextlib.suppress(ValueError, RecursionError, KeyError, TypeError, AttributeError):
        content = json.loads(data)
        own = content["attributes"]["impasto"]
        if chance.random() < 0.9:
            own.pop("crc32", None)
            own["crc32"] = zarr_store._checksum(own)
            return json.dumps(content).encode()
    return data


def members_changed(data: bytes, seeds: list[bytes], chance: random.Random) -> bytes:
    """Three of four archives are whole, with one to three members that are not."""
    if chance.random() < 0.25:
        return data
    members = dict(_members(chance.choice(seeds)))
    for _ in range(chance.choice((1, 1, 1, 2, 3))):
        name = chance.choice(sorted(members))
        kind = chance.randrange(8)
        if kind == 0 and len(members) > 1:
            del members[name]
        elif kind == 1:
            members[name] = chance.choice(list(members.values()))
        elif kind == 2:
            content = BytesIO()
            np.save(content, np.array(chance.choice(VALUES)))
            members[name] = content.getvalue()
        else:
            members[name] = mutated([members[name]], chance, text=False)
    target = BytesIO()
    with zipfile.ZipFile(target, "w") as archive:
        for name, content in members.items():
            archive.writestr(name, content)
    return target.getvalue()


@cache
def _members(data: bytes) -> dict[str, bytes]:
    with zipfile.ZipFile(BytesIO(data)) as archive:
        return {name: archive.read(name) for name in archive.namelist()}
