"""Find the photographs that a light file names."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

from impasto.errors import ArgumentError
from impasto.io.notes import Notebook, few

RULES = {
    "path": "by path",
    "basename": "by file name, ignoring the folders of another computer",
    "stem": "by file name without its ending",
    "order": "by order alone",
}


@dataclass(frozen=True, slots=True)
class Match:
    """The result of :func:`match_names`: for each name its file, or None, and the rule used."""

    paths: tuple[Path | None, ...]
    rules: tuple[str | None, ...]


def basename(name: str) -> str:
    """The last part of a path written on Windows or Unix."""
    return PurePosixPath(name.replace("\\", "/")).name


def match_names(
    names: Sequence[str],
    folder: Path,
    files: Sequence[Path],
    source: Path,
    notebook: Notebook,
) -> Match:
    """Find each name: as a path, by file name (any case), by stem, and last by order.

    Parameters
    ----------
    names
        As written in the light file.
    folder
        Where relative names start.
    files
        The pictures that may be meant, in natural order.
    source
        The light file, for the notes.
    """
    by_name: dict[str, list[Path]] = {}
    by_stem: dict[str, list[Path]] = {}
    for file in files:
        by_name.setdefault(file.name.casefold(), []).append(file)
        by_stem.setdefault(file.stem.casefold(), []).append(file)
    paths: list[Path | None] = []
    rules: list[str | None] = []
    for name in names:
        path, rule = _one(name, folder, by_name, by_stem)
        paths.append(path)
        rules.append(rule)
    if not any(paths):
        if len(files) != len(names):
            raise ArgumentError(
                f"{source}: none of the {len(names)} listed photographs (first: {names[0]!r}) is "
                f"in {folder}, and its {len(files)} pictures cannot be paired by order; "
                "give the folder of the photographs with images="
            )
        paths, rules = list(files), ["order"] * len(names)
        notebook.repair(
            "match",
            source,
            f"none of the listed names (first: {names[0]!r}) exists; the {len(files)} pictures "
            f"of {folder.name} were paired by order alone ({names[0]!r} is {files[0].name}, "
            f"{names[-1]!r} is {files[-1].name}): check this pairing",
        )
        return Match(tuple(paths), tuple(rules))
    for rule, count in Counter(r for r in rules if r not in {None, "path"}).items():
        first = rules.index(rule)
        found = paths[first]
        notebook.repair(
            "match",
            source,
            f"{count} photograph(s) found {RULES[str(rule)]} (first: {names[first]!r} is "
            f"{found.name if found else ''})",
        )
    _refuse_shared(names, paths, source)
    return Match(tuple(paths), tuple(rules))


def _one(
    name: str,
    folder: Path,
    by_name: dict[str, list[Path]],
    by_stem: dict[str, list[Path]],
) -> tuple[Path | None, str | None]:
    for written in (name, name.replace("\\", "/")):
        candidate = folder / written
        try:
            if candidate.is_file():
                return candidate, "path"
        except (OSError, ValueError):  # too long, or a NUL
            continue
    short = basename(name)
    for key, table, rule in (
        (short.casefold(), by_name, "basename"),
        (PurePosixPath(short).stem.casefold(), by_stem, "stem"),
        # AliceVision lists bare stems, which may contain a dot.
        (short.casefold(), by_stem, "stem"),
    ):
        found = table.get(key, [])
        exact = [path for path in found if short in {path.name, path.stem}]
        if len(exact) == 1:
            return exact[0], rule
        if len(found) == 1:
            return found[0], rule
        if found:
            raise ArgumentError(
                f"{name!r} matches {few([path.name for path in found])} in {found[0].parent}: "
                "keep only one of them in the folder"
            )
    return None, None


def _refuse_shared(names: Sequence[str], paths: Sequence[Path | None], source: Path) -> None:
    """Two different names must not match one file; one name may be listed twice."""
    owner: dict[Path, str] = {}
    for name, path in zip(names, paths, strict=True):
        if path is None:
            continue
        other = owner.setdefault(path, name)
        if other != name and basename(other).casefold() != basename(name).casefold():
            raise ArgumentError(
                f"{source}: {other!r} and {name!r} both match {path.name}; correct the light file"
            )
