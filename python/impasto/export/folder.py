"""Where exports go: files and folders that appear whole, and replace only what impasto wrote."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from impasto.errors import ArgumentError
from impasto.export.loss import REPORT
from impasto.io.folders import new_files, new_folder


@contextmanager
def export_folder(out: Path) -> Iterator[Path]:
    """A folder whose files become ``out`` if the block ends without an error.

    Raises
    ------
    ArgumentError
        ``out`` is a file, or holds files that no export wrote.
    """
    if out.is_symlink() or (out.exists() and not out.is_dir()):
        raise ArgumentError(f"out: {out} is a file or a link; give the name of a new folder")
    if out.is_dir() and any(out.iterdir()) and not (out / REPORT).is_file():
        raise ArgumentError(
            f"out: {out} holds files that no export of impasto wrote; give the name of a new folder"
        )
    _make_parent(out)
    with new_folder(out) as folder:
        yield folder


@contextmanager
def export_file(out: Path, *suffixes: str) -> Iterator[tuple[Path, Path]]:
    """Two files, the export and its report, that get their names if the block ends well.

    Until then they lie in a folder of their own; the first has the name of ``out`` there.

    Raises
    ------
    ArgumentError
        Another suffix, or ``out`` is a folder.
    """
    if out.suffix.lower() not in suffixes:
        raise ArgumentError(f"out: expected a name ending in {' or '.join(suffixes)}, found {out}")
    if out.is_dir():
        raise ArgumentError(f"out: {out} is a folder; give the name of a file")
    _make_parent(out)
    with new_files(out, out.with_name(f"{out.name}.{REPORT}")) as (path, report):
        yield path, report


def _make_parent(out: Path) -> None:
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
    except (FileExistsError, NotADirectoryError) as error:
        raise ArgumentError(
            f"out: {out} is to lie in {error.filename}, which is a file; give another name"
        ) from error
