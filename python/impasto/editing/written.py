"""Files that the page writes: checked by their own readers, and never over another's change."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from impasto.errors import ArgumentError, CorruptInputError
from impasto.io.files import atomic_path


class WrittenFile:
    """A file that is edited.

    Parameters
    ----------
    path
        Where it lies, or will lie.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._known = self._bytes()

    def write(self, text: str, read: Callable[[Path], object]) -> None:
        """Replace the file by ``text``, if ``read`` accepts it under a temporary name.

        Raises
        ------
        CorruptInputError
            What ``read`` refuses.
        ArgumentError
            The file was changed by something else since it was read or written here.
        """
        if self._bytes() != self._known:
            raise ArgumentError(
                f"{self.path} was changed by something else; end this command, and start it again "
                "to edit what the file holds now"
            )
        data = text.encode("utf-8")
        with atomic_path(self.path) as temporary:
            temporary.write_bytes(data)
            try:
                read(temporary)
            except CorruptInputError as error:
                raise CorruptInputError(self.path, f"not written: {error.problem}") from error
        self._known = data

    def _bytes(self) -> bytes | None:
        return self.path.read_bytes() if self.path.is_file() else None
