"""The lens and the alignment of a folder's photographs, where their files lie."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from impasto.errors import ArgumentError, CorruptInputError
from impasto.io.notes import few
from impasto.io.session.alignment import Alignment, read_alignment
from impasto.io.session.geometry import check_lens
from impasto.lens import read_lens

REPORT = Path("report") / "alignment.json"
"""In the folder that ``impasto align`` makes."""
STRENGTHS = "light_intensities.txt"
"""In that folder, where the light file has strengths or a white card was measured."""
MASK = "mask.png"
"""Beside the report, where a photograph does not show all of the painting."""


@dataclass(frozen=True)
class Optics:
    """What :func:`find_optics` found.

    Parameters
    ----------
    lens, alignment, mask, strengths
        Their files; None: none that can be used. Strengths are in the order of the photographs'
        names.
    size_mm
        Of the painting, which the alignment says.
    missing
        One line for each thing that was found and is not used.
    """

    lens: Path | None = None
    alignment: Path | None = None
    mask: Path | None = None
    size_mm: tuple[float, float] | None = None
    missing: tuple[str, ...] = ()
    strengths: Path | None = None

    def every(self) -> list[Path]:
        """All files."""
        paths = self.lens, self.alignment, self.mask, self.strengths
        return [path for path in paths if path is not None]


def aligned_folders(folder: Path) -> list[Path]:
    """Folders that ``impasto align`` made: their photographs are none of the camera."""
    return [path for path in sorted(folder.iterdir()) if (path / REPORT).is_file()]


def find_optics(folder: Path, home: Path, photographs: Sequence[Path]) -> Optics:
    """The only lens in the folder, and the only alignment of just these photographs.

    Parameters
    ----------
    folder
        Of the session.
    home
        Of the photographs.
    photographs
        As the camera wrote them.
    """
    missing: list[str] = []
    lenses = _lenses([*dict.fromkeys((folder, home))])
    names = {path.name.casefold() for path in photographs}
    reports = [one for one in _reports(folder) if names <= one.homographies.keys()]
    if len(reports) > 1:
        found = few([one.path.parent.parent.name for one in reports])
        missing.append(f"photographs.alignment: {found} hold one each; name the report of one")
    if len(lenses) > 1:
        found = " and ".join(path.name for path in lenses)
        missing.append(f"camera.lens: {found}; name one")
    lens = lenses[0] if len(lenses) == 1 else None
    if len(reports) != 1:
        return Optics(lens, missing=tuple(missing))
    report = reports[0]
    if report.lens is None and lens is not None:
        missing.append(f"camera.lens: {lens.name} is not used: the alignment was made without it")
        lens = None
    try:
        check_lens(None if lens is None else read_lens(lens), report, lens)
    except ArgumentError as error:
        missing.append(f"photographs.{error}")
        return Optics(lens, missing=tuple(missing))
    mask = report.path.parent / MASK
    own_mask = mask if mask.is_file() else None
    strengths = report.path.parent.parent / STRENGTHS
    return Optics(
        lens, report.path, own_mask, report.grid.size_mm, tuple(missing),
        strengths if strengths.is_file() else None,
    )  # fmt: skip


def _lenses(folders: Sequence[Path]) -> list[Path]:
    found = []
    for path in (path for folder in folders for path in sorted(folder.glob("*.json"))):
        try:
            read_lens(path)
        except (ArgumentError, CorruptInputError):  # another kind of file
            continue
        found.append(path)
    return found


def _reports(folder: Path) -> list[Alignment]:
    found = []
    for path in aligned_folders(folder):
        try:
            found.append(read_alignment(path / REPORT))
        except CorruptInputError:
            continue
    return found
