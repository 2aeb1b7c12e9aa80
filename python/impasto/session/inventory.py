"""A first ``session.toml`` from what lies in a folder."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from impasto._internal.wording import counted
from impasto.calibrate.folder import ball_folders
from impasto.doctor import Finding
from impasto.errors import ArgumentError, MissingExtraError
from impasto.io.images import list_images, natural_key, read_header
from impasto.io.images.exif import Exif, read_exif
from impasto.io.lights import LightFile
from impasto.io.notes import Notebook, few
from impasto.io.session.from_session import IMPLICIT
from impasto.io.session.observations import find_lights
from impasto.io.session.photographs import find_photographs
from impasto.io.session_toml import SESSION_FILE, Session, sha256_of
from impasto.session.filter_wheel import FilterWheel, find_filter_wheel
from impasto.session.optics import aligned_folders, find_optics
from impasto.session.sequence import sequence

_DARK = re.compile(r"^(dark|black|ambient)(?![a-z])", re.I)
_WHITE = re.compile(r"^(white|flat|board)(?![a-z])", re.I)
_MASK = re.compile(r"^mask(?![a-z])", re.I)
_SHARED = 0.5
"""Share of the photographs that state something before it is taken for all."""


@dataclass(frozen=True)
class FoundSession:
    """What :func:`find_session` found.

    Parameters
    ----------
    session
        For :func:`impasto.io.write_session`.
    found, missing
        One line for people for each thing that is there, and that is not known.
    findings
        What EXIF says of the photographs: :func:`impasto.session.sequence`.
    complete
        Whether :func:`impasto.read_stack` can read it: there are lights for the photographs.
    """

    session: Session
    found: tuple[str, ...]
    missing: tuple[str, ...]
    findings: tuple[Finding, ...]
    complete: bool


def find_session(folder: str | Path) -> FoundSession:
    """Describe the photographs of a folder as a session; nothing is written.

    Taken are photographs (in the folder, or in its only subfolder with some) with a file for each
    filter where names end in bands, the light file, the lens and the alignment of the photographs,
    dark frames, white boards and a mask by their names (``dark``, ``black``, ``ambient``;
    ``white``, ``flat``, ``board``; ``mask``), what EXIF says of camera and lens, and the SHA-256 of
    all these files. The tone curve is left to :func:`impasto.read_stack`.

    Parameters
    ----------
    folder
        The folder in which ``session.toml`` will lie.

    Raises
    ------
    ArgumentError
        No folder, no photographs, or several folders of photographs.
    MissingExtraError
        RAW photographs, and rawpy is not installed.
    CorruptInputError
        The light file or the first photograph is damaged.
    """
    folder = Path(folder)
    if not folder.is_dir():
        raise ArgumentError(f"path: {folder} is not a folder")
    balls = ball_folders(folder)
    home = _home(folder, balls)
    light_file, why = _lights(folder, home)
    lights = None if light_file is None else light_file.path
    notebook = Notebook()
    wheel = find_filter_wheel(_candidates(home))
    photographs, problem = _photographs(home, light_file, wheel, notebook)
    optics = find_optics(folder, home, photographs)
    optics = replace(optics, strengths=_strengths(optics.strengths, lights, photographs))
    repairs = [note for note in notebook.notes if note.repair]
    extra = _Frames.of(folder, home, photographs)
    session = Session(
        title=folder.resolve().name or None,
        images=None if home == (lights or folder / SESSION_FILE).parent else home.name,
        lights=None if lights is None else _relative(lights, folder),
        **extra.as_keys(folder),
        lens=None if optics.lens is None else _relative(optics.lens, folder),
        size_mm=optics.size_mm,
        alignment=None if optics.alignment is None else _relative(optics.alignment, folder),
    )
    if optics.strengths is not None:
        session = replace(session, intensities=_relative(optics.strengths, folder))
    if optics.mask is not None:
        session = replace(session, mask=_relative(optics.mask, folder))
    if wheel is not None:
        session = replace(session, pattern=wheel.pattern, bands=wheel.bands)
    header = read_header(photographs[0])
    by_name = sorted(photographs, key=lambda path: natural_key(path.name))
    exif = [read_exif(path) for path in by_name]
    known = _of_camera(exif, header.width, header.height)
    files = [*photographs, *([] if lights is None else [lights]), *extra.every(), *optics.every()]
    files += [path for path in _implicit(lights) if path.is_file()]
    hashes = {_relative(path, folder): sha256_of(path) for path in dict.fromkeys(files)}
    session = replace(session, sha256=hashes, **known)
    findings = sequence([path.name for path in by_name], exif, equalised=False)
    found = [
        f"{counted(len(photographs), 'photograph' if wheel is None else 'file')} of "
        f"{header.width} x {header.height} pixels, "
        f"{photographs[0].name} to {photographs[-1].name}",
        *([] if lights is None else [f"light file {session.lights}"]),
        *([] if wheel is None else [_wheel_words(wheel)]),
        *([] if session.lens is None else [f"lens {session.lens}"]),
        *([] if session.alignment is None else [f"alignment {session.alignment}"]),
        *([] if optics.strengths is None else [f"strengths of the lights {session.intensities}"]),
        *[str(note) for note in repairs if note.kind != "missing"],
        *extra.words(),
        *([f"camera {session.camera}"] if session.camera else []),
        *(
            [f"focal length {session.focal_length_px:.0f} pixels, from EXIF"]
            if session.focal_length_px
            else []
        ),
    ]
    if balls:
        names = few([path.name for path in balls])
        found.append(
            f"{counted(len(balls), 'folder')} of mirror balls ({names}): a light file is made by "
            f"impasto calibrate lights {folder} --out {folder / 'lights.lp'}"
        )
    missing = [why] if why else []
    if light_file is None and not balls:
        missing.append(
            "or, where a mirror ball lies beside the painting: impasto calibrate lights "
            f"{home} --out {folder / 'lights.lp'}; without a ball impasto calibrate "
            "lights-from-painting finds lamps of a matte painting"
        )
    missing += [problem] if problem else []
    missing += _calibrations_among(photographs, folder)
    missing += [note.message for note in repairs if note.kind == "missing"]
    missing += extra.missing(len(photographs if wheel is None else wheel.names))
    missing += optics.missing
    scaled = light_file is not None and (light_file.width_mm or light_file.pitch_mm)
    if not scaled and optics.alignment is None:
        missing.append("photographs.pitch_mm, the width of a pixel: needed for near lamps")
    complete = lights is not None and not problem
    return FoundSession(session, tuple(found), tuple(missing), tuple(findings), complete)


def _home(folder: Path, balls: Sequence[Path]) -> Path:
    """The folder of the photographs."""
    own = [path for path in list_images(folder) if not _is_frame(path.stem)]
    if not all(_shows_a_calibration(path) for path in own):
        return folder
    # Beside photographs, pictures of calibrations lie in a folder of their own.
    made = [*balls, *aligned_folders(folder), folder / "calibration"]
    inner = sorted(path for path in folder.iterdir() if path.is_dir() and path not in made)
    inner = [path for path in inner if not _is_frame(path.name) and list_images(path)]
    if not inner and own:
        return folder
    if not inner:
        raise ArgumentError(f"path: {folder} has no photographs, and no folder with some")
    if len(inner) > 1:
        raise ArgumentError(
            f"path: {folder} has several folders of photographs "
            f"({few([path.name for path in inner])}); a session has one: name it as FOLDER, or "
            "move the others"
        )
    return inner[0]


def _calibrations_among(photographs: Sequence[Path], folder: Path) -> list[str]:
    """Words on pictures of calibrations that count as photographs, if there are others."""
    shown = [path for path in photographs if _shows_a_calibration(path)]
    if not shown or len(shown) == len(photographs):
        return []
    return [
        f"{few([path.name for path in shown])}: written by impasto calibrate, but counted as "
        f"{counted(len(shown), 'photograph')}; move what is none into {folder / 'calibration'}, "
        "and write the session again"
    ]


def _shows_a_calibration(path: Path) -> bool:
    """Whether it is the picture that ``impasto calibrate`` writes beside a file of that name."""
    return path.suffix == ".png" and any(path.with_suffix(end).exists() for end in CALIBRATIONS)


CALIBRATIONS = (".json", ".lp", ".dome", ".csv", ".txt")
"""How the names of the files of a lens, of lamps, of a camera and of strengths end."""


def _is_frame(name: str) -> bool:
    return any(pattern.match(name) for pattern in (_DARK, _WHITE, _MASK))


def _lights(folder: Path, home: Path) -> tuple[LightFile | None, str]:
    """The light file, or why there is none."""
    why = ""
    for place in dict.fromkeys((home, folder)):
        try:
            return find_lights(place, Notebook()), ""
        except ArgumentError as error:
            several = "several" in str(error)
            if several or not why:
                why = str(error).removeprefix("lights: ").split("; ")[0]
            if several:
                break
    return None, f"lights: {why}; write its name as lights.file"


def _strengths(
    aligned: Path | None, lights: Path | None, photographs: Sequence[Path]
) -> Path | None:
    """Those of the alignment, unless the light file has its own beside it or another order."""
    if aligned is None or lights is None or any(path.is_file() for path in _implicit(lights)[:1]):
        return None
    by_name = sorted(photographs, key=lambda path: natural_key(path.name))
    return aligned if list(photographs) == by_name else None


def _candidates(home: Path) -> list[Path]:
    return [path for path in list_images(home) if not _is_frame(path.stem)]


def _photographs(
    home: Path, lights: LightFile | None, wheel: FilterWheel | None, notebook: Notebook
) -> tuple[list[Path], str]:
    """The files that belong to the lights; without lights, all that are no calibration frames."""
    every = _candidates(home)
    if lights is None:
        return every, ""
    options: dict[str, Any] = {}
    if wheel is not None:
        options = {"pattern": wheel.pattern, "bands": wheel.bands}
    try:
        _, found = find_photographs(lights.path, notebook, images=home, **options)
    except MissingExtraError:
        raise
    except ArgumentError as error:
        return every, str(error)
    listed = [path for files in found.files for path in files]
    spare = [path.name for path in every if path not in listed]
    return listed, f"{few(spare)}: not in {lights.path.name}, not used" if spare else ""


def _wheel_words(wheel: FilterWheel) -> str:
    count = counted(len(wheel.names), "photograph")
    return f"{count} with a file for each band, {wheel.pattern}: {', '.join(wheel.bands)}"


@dataclass(frozen=True)
class _Frames:
    """Calibration frames by their names; a folder stands for what lies in it."""

    dark: tuple[Path, ...]
    white: tuple[Path, ...]
    mask: tuple[Path, ...]

    @classmethod
    def of(cls, folder: Path, home: Path, photographs: Sequence[Path]) -> _Frames:
        """In the folder of the session, or in that of the photographs."""
        places = dict.fromkeys((folder, home))
        files = [path for place in places for path in list_images(place)]
        inner = [path for path in sorted(folder.iterdir()) if path.is_dir() and list_images(path)]
        files = [path for path in files if path not in photographs]

        def named(pattern: re.Pattern[str]) -> tuple[Path, ...]:
            folders = [path for path in inner if path != home and pattern.match(path.name)]
            return tuple(folders[:1] or [path for path in files if pattern.match(path.stem)])

        return cls(named(_DARK), named(_WHITE), named(_MASK)[:1])

    def as_keys(self, folder: Path) -> dict[str, Any]:
        """Values of the session."""
        found: dict[str, Any] = {}
        for name in ("dark", "white", "mask"):
            names = tuple(_relative(path, folder) for path in getattr(self, name))
            if names:
                found[name] = names[0] if len(names) == 1 else names
        return found

    def every(self) -> list[Path]:
        """All files."""
        paths = [*self.dark, *self.white, *self.mask]
        return [one for path in paths for one in (list_images(path) if path.is_dir() else [path])]

    def words(self) -> list[str]:
        """For people."""
        nouns = {"dark": "dark frames", "white": "white board", "mask": "mask"}
        return [
            f"{noun}: {few([path.name for path in getattr(self, name)])}"
            for name, noun in nouns.items()
            if getattr(self, name)
        ]

    def missing(self, count: int) -> list[str]:
        """What calibration frames would be good for."""
        lost = []
        if not self.dark:
            lost.append("calibration.dark: without it the black level of the files counts as 0")
        if not self.white:
            lost.append(
                "calibration.white: without it vignetting, fall-off and unequal lamps remain"
            )
        white = [one for path in self.white for one in ([path] if path.is_file() else [])]
        if len(white) > 1 and len(white) != count:
            lost.append(f"calibration.white: {len(white)} boards for {count} photographs: one each")
        return lost


def _of_camera(exif: Sequence[Exif], width: int, height: int) -> dict[str, Any]:
    """Name and focal length of the camera, where most photographs agree."""
    found: dict[str, Any] = {}
    camera = _most(one.camera for one in exif)
    if isinstance(camera, str):
        found["camera"] = camera
    focal = _most(one.focal_length_px(width, height) for one in exif)
    if isinstance(focal, float):
        found["focal_length_px"] = round(focal, 1)
    return found


def _most(values: Iterable[str | float | None]) -> str | float | None:
    counts = Counter(values)
    value, count = counts.most_common(1)[0]
    return value if count > _SHARED * counts.total() else None


def _implicit(lights: Path | None) -> list[Path]:
    return [] if lights is None else [lights.with_name(name) for name in IMPLICIT]


def _relative(path: Path, folder: Path) -> str:
    try:
        return path.relative_to(folder).as_posix()
    except ValueError:
        return str(path)
