"""Where the files of a job are: under the name of a store, or of one that is not finished."""

from __future__ import annotations

import difflib
import os
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import TypeVar

from impasto.errors import ArgumentError, CorruptInputError
from impasto.io.results.maps import MERGE
from impasto.io.session.stored import is_stack
from impasto.jobs.folder import NOTES, RECORD, SUFFIX, has_begun, partial_of, store_name
from impasto.jobs.journal import JOURNAL, Entries, read_journal
from impasto.jobs.lock import LOCK, holder

ALIKE = 0.75
"""How much of a name must be that of a job before this is asked for."""
Seen = TypeVar("Seen")


def in_folder_of(out: str | os.PathLike[str], look: Callable[[Path, bool], Seen]) -> Seen:
    """What is seen in the folder of a job, of which ``look`` gets to know whether it is finished.

    It looks again where the job has ended meanwhile, and its folder has another name.

    Raises
    ------
    ArgumentError
        There is no job of that name.
    """
    while True:
        folder, whole = folder_of(out)
        try:
            seen = look(folder, whole)
        except (FileNotFoundError, CorruptInputError):
            if folder.exists():
                raise
        else:
            if folder.exists():
                return seen


def folder_of(out: str | os.PathLike[str]) -> tuple[Path, bool]:
    """The folder of a job, and whether it is finished.

    Raises
    ------
    ArgumentError
        There is no job of that name.
    """
    target = store_name(out)
    # The finished one once more: it may have got its name since it was looked for.
    for folder, whole in ((target, True), (partial_of(target), False), (target, True)):
        if (folder / NOTES / RECORD).exists():
            return folder, whole
    if any((folder / MERGE).is_dir() for folder in (target, partial_of(target))):
        raise ArgumentError(
            f"{target} is no job, but made by impasto job merge: impasto job verify compares its "
            "files"
            if target.exists()
            else f"{target} is an unfinished merge: the same impasto job merge, or impasto.merge, "
            "goes on with it"
        )
    early = partial_of(target) / NOTES
    if (by := holder(early)) is not None:
        raise ArgumentError(
            f"{target} is a job that has just begun: {by} reads its photographs; wait "
            "for it (impasto job status says how far it is)"
        )
    if (early / LOCK).exists():
        raise ArgumentError(
            f"{target} is a job that was ended while its photographs were read, so that nothing "
            "of it is there yet: give the same impasto job run, or impasto.run, once more"
        )
    if holds_photographs(target):
        raise ArgumentError(
            f"{target} holds photographs, not a job; impasto job verify compares its files"
        )
    if not target.exists() and not partial_of(target).exists():
        raise ArgumentError(f"{target} does not exist{_jobs_beside(target)}")
    raise ArgumentError(
        f"{target} is no job of impasto: expected the name that impasto.run or impasto job run was "
        f"given as out{_jobs_beside(target)}"
    )


def holds_photographs(target: Path) -> bool:
    """Whether it is a store of photographs, as of :func:`impasto.ingest`, that can be opened."""
    if (target / NOTES / RECORD).exists():
        return False
    with suppress(CorruptInputError, FileNotFoundError):
        return is_stack(target)
    return False


def _jobs_beside(target: Path) -> str:
    """The jobs of the same folder, of which one may be meant."""
    with suppress(OSError):
        records = sorted(target.absolute().parent.glob(f"*/{NOTES}/{RECORD}"))
        names = {name.removesuffix(SUFFIX): name for name in (_store_of(one) for one in records)}
        wanted = target.name.removesuffix(SUFFIX)
        beginning = [stem for stem in names if stem.startswith(wanted)]
        if near := (beginning or difflib.get_close_matches(wanted, names, n=1, cutoff=ALIKE)):
            return f"; did you mean {names[near[0]]!r}?"
    return ""


def _store_of(record: Path) -> str:
    return store_name(record.parents[1]).name


def journal_in(notes: Path) -> Entries | None:
    """The journal; None where no tile can have been written."""
    try:
        return read_journal(notes / JOURNAL)
    except FileNotFoundError:
        return None
    except CorruptInputError:
        if (notes / LOCK).exists() and not has_begun(notes):
            return None  # killed while it was begun
        return read_journal(notes / JOURNAL)  # its first line may have come while it was read
