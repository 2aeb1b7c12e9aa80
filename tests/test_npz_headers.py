"""Headers of arrays that numpy reads with a warning, or not at all, are damage."""

from __future__ import annotations

import struct
import zipfile
from pathlib import Path

import pytest

from impasto import CorruptInputError, read_stack

PLAIN = "{'descr': '<f4', 'fortran_order': False, 'shape': (5, 1, 2, 2), }"


def archive(path: Path, header: str) -> Path:
    """An archive with an array of 20 numbers that has this header."""
    text = header.encode().ljust(117) + b"\n"
    with zipfile.ZipFile(path, "w") as file:
        head = b"\x93NUMPY\1\0" + struct.pack("<H", len(text))
        file.writestr("samples.npy", head + text + bytes(80))
    return path


@pytest.mark.parametrize(
    "header",
    [
        PLAIN.replace("5,", "5L,"),  # of Python 2
        "\n " + PLAIN,
        PLAIN.replace("<f4", "|a4"),
        PLAIN.replace("'<f4'", "[('a', '<f4')]"),
        PLAIN.replace("5,", "5"),
        "[1, 2]",
    ],
)
def test_a_damaged_header_is_told_from_another_file(tmp_path: Path, header: str) -> None:
    with pytest.raises(CorruptInputError, match=r"stack\.npz: .*header"):
        read_stack(archive(tmp_path / "stack.npz", header))


def test_a_whole_header_is_none_of_these(tmp_path: Path) -> None:
    with pytest.raises(CorruptInputError, match="lights"):
        read_stack(archive(tmp_path / "stack.npz", PLAIN))
