"""Errors of whole calls.

A wrong call raises; a bad pixel never does: it carries a :class:`~impasto.Status`. Where a builtin
exception says what went wrong, the class here is also that builtin.
"""

import re

from impasto._internal.printable import printable

_NUMPY_SCALAR = re.compile(r"\bnp\.(?:float|int|uint|bool|str)_?\d*\(([^()]*)\)")
"""How numpy prints a number in a message that shows the caller's value."""


class ImpastoError(Exception):
    """Base class of all errors of impasto.

    Numbers in messages are plain: 0.5. Control characters, which names of files may hold, are
    written as in source code, so that they do not reach a terminal.
    """

    _lines = False
    """Whether a message may have several lines."""

    def __init__(self, *arguments: object) -> None:
        super().__init__(
            *(
                printable(_NUMPY_SCALAR.sub(r"\1", a), lines=self._lines)
                if isinstance(a, str)
                else a
                for a in arguments
            )
        )


class ImpastoWarning(UserWarning):
    """Something that is probably not meant; the message says what to do."""


class ArgumentError(ImpastoError, ValueError):
    """The value of an argument cannot be used; the message names argument and value."""


class GeometryError(ArgumentError):
    """Lights, views or sizes that contradict each other or cannot determine the surface."""


class ResumeMismatchError(ArgumentError):
    """A job is to go on with other photographs or options; the message names the differences."""


class CorruptInputError(ImpastoError, ValueError):
    """A file is truncated, damaged or of another type than its name says."""

    def __init__(self, path: object, problem: str) -> None:
        super().__init__(f"{path}: {problem}")
        self.path = path
        self.problem = problem

    def __reduce__(self) -> tuple[type["CorruptInputError"], tuple[object, str]]:
        """To another process, as a worker sends it."""
        return type(self), (self.path, self.problem)


class MissingExtraError(ImpastoError, ImportError):
    """A library that the call needs is not installed; the message names its extra."""


class GpuUnavailableError(ImpastoError, RuntimeError):
    """No graphics card can make this picture; the message says why and what to do."""


class ClusterError(ImpastoError, RuntimeError):
    """The workers or the scheduler of a Dask cluster were lost; the job can be resumed."""


class DeviceError(ImpastoError, RuntimeError):
    """A camera, its lamps or its stage did not do what was ordered; the message says what to do."""


class DisconnectedError(DeviceError):
    """A device is not there (any more): a cable, a power supply, a name of a port."""


class InternalError(ImpastoError, RuntimeError):
    """A defect in impasto itself (a panic of the numerics): please report it."""
