"""The files of each observation: find lights, match names, collect bands."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from string import Formatter

from impasto.errors import ArgumentError
from impasto.io.files import read_text
from impasto.io.images import list_images, natural_key
from impasto.io.lights import LIGHT_SUFFIXES, LightFile, read_lights
from impasto.io.notes import Notebook, few
from impasto.io.session.match import basename, match_names

_NOT_PHOTOGRAPHS = re.compile(
    r"^(mask|white|board|flat|dark|black|ambient|ref|normals?[_-]gt)", re.I
)
_TEXT_LIGHTS = ("lights.csv", "light_directions.txt", "lights.txt")


@dataclass(frozen=True, slots=True)
class Observations:
    """The files of each observation that is complete.

    Parameters
    ----------
    files
        For each observation its files in band order (one file, unless there is a pattern).
    names
        One name per observation.
    kept
        The index of each observation in the light file.
    band_names
        What the pattern's ``{band}`` stood for, else empty.
    """

    files: tuple[tuple[Path, ...], ...]
    names: tuple[str, ...]
    kept: tuple[int, ...]
    band_names: tuple[str, ...] = ()


def find_lights(folder: Path, notebook: Notebook) -> LightFile:
    """The one light file of a folder."""
    found = sorted(
        (p for p in folder.iterdir() if p.suffix.lower() == ".lp" and not p.name.startswith(".")),
        key=lambda p: p.name,
    )
    if not found:
        found = [folder / name for name in _TEXT_LIGHTS if (folder / name).is_file()][:1]
    if not found:
        found = sorted(p for p in folder.iterdir() if p.suffix.lower() in {".dome", ".relight"})
    if not found:
        raise ArgumentError(
            f"lights: {folder} has no light file (*.lp, {', '.join(_TEXT_LIGHTS)}, *.dome, "
            "*.relight); give the one of these photographs with lights=, or make one from "
            "photographs of a mirror ball by impasto calibrate lights (of a matte painting alone: "
            "lights-from-painting)"
        )
    if len(found) > 1:
        raise ArgumentError(
            f"lights: {folder} has several light files ({few([p.name for p in found])}); "
            "choose one with lights="
        )
    notebook.say("lights", found[0], "used as the light file of this folder")
    return read_lights(found[0], strict=notebook.strict)


def find_observations(
    names: Sequence[str] | None,
    count: int,
    folder: Path,
    source: Path,
    notebook: Notebook,
    *,
    pattern: str | Sequence[str] | None = None,
    bands: Sequence[str] | None = None,
    excluded: Sequence[Path] = (),
) -> Observations:
    """The files of each of ``count`` lights.

    ``excluded`` are other pictures (mask, white board), not photographs of the object.
    """
    if not folder.is_dir():
        raise ArgumentError(f"images: {folder} is not a folder")
    if names is None:
        names = _companion_names(source, count, notebook)
    if pattern is not None:
        return _by_pattern(names, count, folder, source, notebook, pattern, bands)
    hidden = {path.resolve() for path in excluded}
    pictures = [path for path in list_images(folder) if path.resolve() not in hidden]
    if names is None:
        return _by_order(pictures, count, folder, source, notebook)
    candidates = [path for path in pictures if not _NOT_PHOTOGRAPHS.match(path.stem)]
    if len(candidates) != len(names):
        candidates = pictures
    match = match_names(names, folder, candidates, source, notebook)
    missing = [names[i] for i, path in enumerate(match.paths) if path is None]
    if missing:
        notebook.repair(
            "missing",
            source,
            f"{len(missing)} of {len(names)} listed photographs not found in {folder}: "
            f"{few(missing)}; those observations are left out",
        )
    used = {path.resolve() for path in match.paths if path is not None}
    spare = [p.name for p in candidates if p.resolve() not in used]
    spare = [name for name in spare if not _NOT_PHOTOGRAPHS.match(name)]
    if spare:
        notebook.warn(
            "unlisted",
            source,
            f"{len(spare)} picture(s) in {folder.name or folder} are not listed and not used: "
            f"{few(spare)}",
        )
    kept = [i for i, path in enumerate(match.paths) if path is not None]
    return Observations(
        tuple((path,) for path in match.paths if path is not None),
        tuple(basename(names[i]) for i in kept),
        tuple(kept),
    )


def _companion_names(source: Path, count: int, notebook: Notebook) -> tuple[str, ...] | None:
    """``filenames.txt`` beside a light file without names."""
    path = source.with_name("filenames.txt")
    if source.suffix.lower() == ".lp" or not path.is_file():
        return None
    names = tuple(line.strip() for line in read_text(path).splitlines() if line.strip())
    if len(names) != count:
        raise ArgumentError(f"{path}: names {len(names)} photographs for {count} lights")
    notebook.say("names", path, "used as the names of the photographs")
    return names


def _by_order(
    pictures: list[Path], count: int, folder: Path, source: Path, notebook: Notebook
) -> Observations:
    if len(pictures) != count:
        pictures = [path for path in pictures if not _NOT_PHOTOGRAPHS.match(path.stem)]
    if len(pictures) != count:
        raise ArgumentError(
            f"{source}: has {count} lights and no file names, but {folder} has "
            + (
                f"{len(pictures)} pictures; remove the others or write an .lp file"
                if len(pictures) > count
                else f"{len(pictures) or 'no'} pictures; give their folder with images="
            )
        )
    notebook.say(
        "match",
        source,
        f"names no files: light 1 is {pictures[0].name}, light {count} is {pictures[-1].name}",
    )
    return Observations(
        tuple((path,) for path in pictures), tuple(p.name for p in pictures), tuple(range(count))
    )


def _by_pattern(
    names: Sequence[str] | None,
    count: int,
    folder: Path,
    source: Path,
    notebook: Notebook,
    pattern: str | Sequence[str],
    bands: Sequence[str] | None,
) -> Observations:
    """Several files per observation (a filter wheel): ``{name}`` and ``{band}`` filled in."""
    patterns = [pattern] if isinstance(pattern, str) else list(pattern)
    if not patterns or not all("{name}" in p for p in patterns):
        raise ArgumentError(f"pattern: expected {{name}} in each of {patterns}")
    for text in patterns:
        _fill(text, "name", "band")
    stems = (
        _discover(folder, patterns[0], "name", "*")
        if names is None
        else [Path(basename(name)).stem for name in names]
    )
    if len(stems) != count:
        raise ArgumentError(
            f"{source}: has {count} lights, the pattern {patterns[0]!r} finds {len(stems)} "
            f"observations in {folder}"
        )
    tokens: list[str] = []
    if isinstance(pattern, str) and "{band}" in pattern:
        tokens = list(bands) if bands is not None else _discover(folder, pattern, "band", "*")
        if not tokens:
            raise ArgumentError(f"pattern: {pattern!r} matches no file in {folder}")
        patterns = [pattern] * len(tokens)
    elif any("{band}" in p for p in patterns):
        raise ArgumentError("pattern: a list of patterns is one per band, without {band}")
    files: list[tuple[Path, ...]] = []
    kept: list[int] = []
    missing: list[str] = []
    for index, stem in enumerate(stems):
        paths = [
            folder / _fill(p, stem, tokens[k] if tokens else "") for k, p in enumerate(patterns)
        ]
        absent = [path.name for path in paths if not path.is_file()]
        if absent:
            missing += absent
        else:
            files.append(tuple(paths))
            kept.append(index)
    if not kept:
        raise ArgumentError(
            f"pattern: no observation is complete in {folder}; missing: {few(missing)}"
        )
    if missing:
        notebook.repair(
            "missing",
            source,
            f"{len(missing)} file(s) not found in {folder}: {few(missing)}; "
            f"{len(stems) - len(kept)} observation(s) left out",
        )
    return Observations(tuple(files), tuple(stems[i] for i in kept), tuple(kept), tuple(tokens))


def _fill(pattern: str, name: str, band: str) -> str:
    try:
        fields = [(f, s, c) for _, f, s, c in Formatter().parse(pattern) if f is not None]
        # An attribute, or a width of a billion characters.
        if odd := [
            field[0] for field in fields if field[1] or field[2] or set(field[0]) & set(".[")
        ]:
            raise ValueError(f"{odd[0]!r} has a format")
        return pattern.format(name=name, band=band)
    except (KeyError, IndexError, ValueError) as error:
        raise ArgumentError(
            f"pattern: {pattern!r} may contain {{name}} and {{band}} only ({error})"
        ) from error


def _discover(folder: Path, pattern: str, wanted: str, other: str) -> list[str]:
    """The values of ``{name}`` or ``{band}`` in the files of a folder, in natural order."""
    groups = {"name": "(?P<name>.+)", "band": "(?P<band>[^_/]+)"}
    expression = re.escape(pattern)
    for key, group in groups.items():
        expression = expression.replace(re.escape(f"{{{key}}}"), group, 1)
        expression = expression.replace(re.escape(f"{{{key}}}"), f"(?P={key})")
    found = set()
    try:
        paths = list(folder.glob(_fill(pattern, other, other)))
    except (NotImplementedError, ValueError, IndexError) as error:  # /..., a**
        raise ArgumentError(
            f"pattern: expected a file name, found {pattern!r} ({error})"
        ) from error
    for path in paths:
        match = re.fullmatch(expression, path.relative_to(folder).as_posix())
        if match is not None:
            found.add(match.group(wanted))
    return sorted(found, key=natural_key)


def is_light_file(path: Path) -> bool:
    """Whether the ending is one of a light file."""
    return path.suffix.lower() in LIGHT_SUFFIXES
