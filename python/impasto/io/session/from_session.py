"""A ``session.toml`` as arguments of :func:`impasto.read_stack`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Self

import numpy as np

from impasto.errors import ArgumentError
from impasto.io.images import MAX_PIXELS
from impasto.io.lights import LightFile
from impasto.io.lights.light_file import finish
from impasto.io.lights.tables import unit_views
from impasto.io.notes import Notebook, few
from impasto.io.session.alignment import read_alignment
from impasto.io.session.brackets import Brackets, place_of
from impasto.io.session.frames import frame_paths
from impasto.io.session.geometry import Geometry, check_lens, curve_of
from impasto.io.session.photographs import find_photographs, read_photographs
from impasto.io.session_toml import KEYS, Session, read_session, verify
from impasto.io.session_toml.hashes import confined, root, unlisted
from impasto.io.session_toml.values import names
from impasto.io.tone_curve import SUFFIX
from impasto.lens import read_lens
from impasto.rig import Rig
from impasto.stack import Stack

KIND = "session"
"""Of the notes that are about a session."""
DEFAULTS = {"strict": False, "max_pixels": MAX_PIXELS}
"""Values that count as not given; of all other arguments None does."""
_SAME_PITCH = 1e-3
"""Relative difference of the width of a pixel, which is written with three digits."""
IMPLICIT = ("light_intensities.txt", "filenames.txt")
"""Read beside a light file without being named."""
_LAMPS = ("lights", "directions", "positions_mm")
_ARGUMENTS = {
    key.attribute: key.name
    for key in KEYS
    if key.name.split(".")[0] in {"photographs", "lights", "calibration"}
}
_RESAMPLING = {"alignment": "photographs.alignment", "lens": "camera.lens"}
"""No arguments of :func:`impasto.read_stack`."""
_MERGING = ("brackets", "noise")
"""Likewise; they name no files that lie in the folder of the session."""


class SessionPhotographs:
    """What a session says, with the arguments that were given beside it.

    Parameters
    ----------
    session
        As read from a file.
    given
        Arguments of :func:`impasto.read_stack`; they win over the session.
    notebook
        Takes notes on what is not used.

    Attributes
    ----------
    session
        The contents of the file.
    path
        The light file, or the folder of the photographs.
    arguments
        Of :func:`impasto.read_stack` for that path.
    geometry
        What the photographs are resampled by; None where the session has no lens or alignment.

    Raises
    ------
    ArgumentError
        Files outside of the session's folder, missing files.
    """

    def __init__(self, session: Session, given: Mapping[str, Any], notebook: Notebook) -> None:
        self.session = session
        self._given = {
            name: value
            for name, value in given.items()
            if value is not None and not _is_default(name, value)
        }
        self._notebook = notebook
        self._rig_given = isinstance(self._given.get("lights"), Rig)
        self._say_overridden()
        self.path, own = self._own()
        paths = {name: own.pop(name, None) for name in _RESAMPLING}
        self.arguments: dict[str, Any] = own | self._given
        self.geometry = self._geometry(**paths)

    @classmethod
    def verified(cls, path: Path, given: Mapping[str, Any]) -> Self:
        """Of a session file or its folder; all files whose hash it states are compared with that.

        Raises
        ------
        ArgumentError
            Also errors of :func:`~impasto.io.read_session`.
        CorruptInputError
            A file has another hash.
        """
        session = read_session(path)
        notebook = Notebook(session.strict or given.get("strict") is True)
        if path.is_dir():
            notebook.say(KIND, _file(session), "used as the session of this folder")
        if given.get("images") is None:
            verify(session)
        elif session.sha256:
            message = "hashes are not compared, since another folder was given (images=)"
            notebook.warn(KIND, _file(session), message)
        return cls(session, given, notebook)

    def files(self) -> tuple[tuple[Path, ...], ...]:
        """The files of each photograph, in the order of the lights; none of them is opened.

        There are several where bands have files of their own (``photographs.pattern``).

        Raises
        ------
        ArgumentError
            None is found, or the light file does not say which is which.
        """
        wanted = {"lights", "images", "mask", "white", "dark", "pattern", "bands", "names"}
        arguments = {name: self.arguments[name] for name in self.arguments.keys() & wanted}
        try:
            _, found = find_photographs(self.path, Notebook(), others=self._others, **arguments)
        except ArgumentError as error:
            raise self._located(error) from error
        self._guard([path for files in found.files for path in files], Notebook())
        return found.files

    def read(self, **changes: Any) -> Stack:
        """The stack; ``changes`` replace arguments, None leaves them out."""
        arguments = {**self.arguments, **changes}
        arguments = {name: value for name, value in arguments.items() if value is not None}
        try:
            stack = read_photographs(
                self.path, guard=self._guard, geometry=self.geometry, **arguments
            )
        except ArgumentError as error:
            raise self._located(error) from error
        return stack._replace(
            notes=(*self._notebook.notes, *stack.notes),
            sources=tuple(
                dict.fromkeys((_file(self.session), *stack.sources, *self._others, *self._optics))
            ),
        )

    def _geometry(self, lens: Path | None, alignment: Path | None) -> Geometry | None:
        self._optics: list[Path] = []
        brackets = self._brackets()
        if lens is None and alignment is None and brackets is None:
            return None
        optics = None if lens is None else read_lens(lens)
        report = None if alignment is None else read_alignment(alignment)
        self._optics += [] if lens is None else [lens]
        self._optics += [] if report is None else report.files
        saturation = self.arguments.get("saturation")
        try:
            check_lens(optics, report, lens)
            if saturation is not None and np.size(saturation) != 1:
                raise ArgumentError(
                    "saturation: one code for all bands where photographs are resampled, found "
                    f"{saturation}"
                )
            if report is not None:
                self._check_pitch(report.grid.pixel_mm)
            return Geometry(
                optics,
                report,
                curve_of(self.arguments.get("encoding")),
                None if saturation is None else float(np.ravel(saturation)[0]),
                brackets,
            )
        except ArgumentError as error:
            raise self._located(error) from error

    def _brackets(self) -> Brackets | None:
        """Files and times of all brackets; the files must be there."""
        self._others: list[Path] = []
        listed, dark = self.session.brackets, self.arguments.get("dark")
        if listed is None:
            return None
        own = self.path if self.path.is_dir() else self.path.parent
        folder = Path(self.arguments.get("images", own))
        frames: dict[Path, list[tuple[Path, float]]] = {}
        for name, times in listed.items():
            paths = [(folder / one, seconds) for one, seconds in times]
            for path, _ in paths:
                if not path.is_file():
                    place = self.session.place(f"photographs.brackets.{name}")
                    raise ArgumentError(f"{place}: {path} does not exist")
            frames[place_of(folder / name)] = paths
        level: Any = None if dark is None else frame_paths(dark)
        if dark is not None and level is None:
            level = np.asarray(dark, np.float64)
            if level.ndim > 1:
                raise ArgumentError("dark: with brackets, dark frames are files; found an array")
        noise = self.session.noise
        found = Brackets(frames, level, *(() if noise is None else (noise,)))
        self._others = found.others
        return found

    def _check_pitch(self, pixel_mm: float) -> None:
        pitch = self.arguments.get("pitch_mm")
        if pitch is not None and abs(pitch / pixel_mm - 1.0) > _SAME_PITCH:
            raise ArgumentError(
                f"pitch_mm: {pitch:g}, but a pixel of the alignment is {pixel_mm:g} mm wide; "
                "leave it out"
            )

    def _say_overridden(self) -> None:
        # A Rig has strengths of its own.
        lamps = (*_LAMPS, "intensities") if self._rig_given else _LAMPS
        for argument in self._given:
            for attribute in lamps if argument == "lights" else (argument,):
                key = _ARGUMENTS.get(attribute)
                if key is None or not self._has(attribute):
                    continue
                self._notebook.say(
                    KIND,
                    _file(self.session),
                    f"{key} is not used, since {argument}= was given",
                )

    def _has(self, attribute: str) -> bool:
        value = getattr(self.session, attribute)
        return value is not None and value is not False  # a black level of 0 is a value

    def _own(self) -> tuple[Path, dict[str, Any]]:
        """Where reading starts, and the session's arguments."""
        session, own = self.session, {}
        for key in KEYS:
            known = key.name in _ARGUMENTS.values() or key.attribute in _RESAMPLING
            if not known or key.attribute in (*_LAMPS, "views", *_MERGING):
                continue
            value = getattr(session, key.attribute)
            if self._has(key.attribute) and key.attribute not in self._given:
                # The name of a curve, or that of a file.
                named = key.files or (
                    key.attribute == "encoding" and str(value).lower().endswith(SUFFIX)
                )
                own[key.attribute] = self._inside(value, key.name) if named else value
        lamps = self._given.get("lights")
        if "white" in self._given:
            own.pop("board_exposure", None)
        if self._rig_given:
            own.pop("intensities", None)
        folder = Path(self._given.get("images", own.get("images", root(session))))
        named = isinstance(lamps, str | Path | LightFile)
        if session.lights is not None:
            path = confined(session, root(session) / session.lights, "lights.file")
            if named:
                return (folder if "images" in {*own, *self._given} else path.parent), own
            if not path.is_file():
                raise ArgumentError(f"{session.place('lights.file')}: {path} does not exist")
            self._check_implicit(path.parent)
            return path, own
        if lamps is None:
            own["lights"] = _lights_of(session)
            self._check_implicit(root(session))
        elif not named and (listed := session.positions_mm or session.directions):
            own["names"] = tuple(listed)  # they say which photograph each of the lights is for
        return folder, own

    def _inside(self, value: Any, key: str) -> Any:
        """Names of files as paths inside the session's folder; anything else as it is."""
        paths = [confined(self.session, root(self.session) / name, key) for name in names(value)]
        if not paths:
            return value
        for path in paths:
            if not path.exists():
                raise ArgumentError(f"{self.session.place(key)}: {path} does not exist")
            if key.startswith("calibration."):
                for frame in frame_paths(path) or ():
                    confined(self.session, frame, key)
        return paths if isinstance(value, tuple) else paths[0]

    def _check_implicit(self, folder: Path) -> None:
        for name in IMPLICIT:
            if (folder / name).exists():
                confined(self.session, folder / name, "lights")

    def _guard(self, photographs: Sequence[Path], notebook: Notebook) -> None:
        """Photographs that a light file names may lie anywhere."""
        if "images" in self._given:
            return
        photographs = [*photographs, *self._others]
        for path in photographs:
            confined(self.session, path, "photographs")
        if self.session.sha256 and (others := unlisted(self.session, photographs)):
            notebook.warn(
                KIND,
                _file(self.session),
                f"{len(others)} photograph(s) have no hash in [files]: {few(others)}",
            )

    def _located(self, error: ArgumentError) -> ArgumentError:
        """An error about an argument that the session gave has its place in the file."""
        argument, colon, problem = str(error).partition(": ")
        if not colon or argument in self._given or argument not in _ARGUMENTS:
            return error
        attribute = argument
        if argument == "lights":
            attribute = next((one for one in _LAMPS if self._has(one)), argument)
        if not self._has(attribute):
            return error
        return type(error)(f"{self.session.place(_ARGUMENTS[attribute])}: {problem}")


def _is_default(name: str, value: Any) -> bool:
    return name in DEFAULTS and value == DEFAULTS[name]


def _file(session: Session) -> Path:
    assert session.path is not None  # it was read
    return session.path


def _lights_of(session: Session) -> LightFile:
    """The lights that stand in the session itself."""
    lamps = session.positions_mm or session.directions
    if lamps is None:
        raise ArgumentError(
            f"{_file(session)}: says nothing of the lights; write lights.file or "
            "lights.directions, give lights=, or make a light file from photographs of a mirror "
            "ball by impasto calibrate lights"
        )
    vectors = np.array(list(lamps.values()), dtype=np.float64)
    views = None
    if session.views is not None:
        views = unit_views([session.views[name] for name in lamps], _file(session))
    return finish(
        _file(session),
        KIND,
        vectors,
        [f"{name!r}" for name in lamps],
        Notebook(session.strict),
        names=tuple(lamps),
        positions=vectors if session.positions_mm else None,
        views=views,
    )
