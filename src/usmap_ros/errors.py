"""The errors that usmap_ros raises for unusable data, all under one root.

Each message is one line that a user can act on: it names the file or message, the field
where there is one, and the cause.  The command line prints it behind ``usmap: error:``.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

#: Longest cause that an error gives: what it quotes may be a megabyte of somebody's text.
_LONGEST_CAUSE, _LONGEST_FIELD, _LONGEST_NAME = 400, 100, 400


def shortened(text: str, length: int) -> str:
    """Text in one line of at most `length` characters, its end cut where it is longer."""
    # The first characters are enough to look at, however long the text is.
    line = " ".join(text[: 4 * length].split())
    return line if len(line) <= length else line[: length - 1] + "…"


class UsmapError(Exception):
    """Root of every error that bad input can cause."""


def _shown(path: str | Path) -> str:
    """A file's name as text: without what breaks a terminal, and its beginning cut if long."""
    name = str(path).replace("\0", "\\0")
    return name if len(name) <= _LONGEST_NAME else f"…{name[1 - _LONGEST_NAME :]}"


class FileError(UsmapError):
    """A file or folder that cannot be used.

    Parameters
    ----------
    path : path-like
        The file, as the user named it.
    cause : str
        What is wrong with it, as a clause without a full stop.
    """

    def __init__(self, path: str | Path, cause: str) -> None:
        self.path = Path(path)
        self.cause = shortened(cause, _LONGEST_CAUSE)
        super().__init__(f"{_shown(path)}: {self.cause}")


class BagError(FileError):
    """A recording that cannot be read or written."""


class MapFileError(FileError):
    """A map file that cannot be read or written."""


class ConfigurationError(FileError):
    """A YAML file with an unknown key or a value out of range."""


@contextmanager
def file_errors(kind: type[FileError], path: str | Path, action: str = "written") -> Iterator[None]:
    """Turn what the operating system says of a file into an error that names it.

    Parameters
    ----------
    kind : type of FileError
        The error to raise.
    path : path-like
        The file or folder, as the user named it.
    action : str
        What is done to it: written, read, made.
    """
    try:
        yield
    except OSError as error:
        if action == "read" and isinstance(error, FileNotFoundError):
            raise kind(path, "does not exist") from error
        raise kind(path, f"cannot be {action}: {error.strerror or error}") from error


class MapSizeError(UsmapError):
    """A map whose rectangle would take too much memory."""


class MalformedMessageError(UsmapError):
    """A message whose content no physical sensor could have produced.

    Parameters
    ----------
    field : str
        The offending field, in the notation of the message definition.
    cause : str
        What is wrong with it.
    """

    def __init__(self, field: str, cause: str) -> None:
        self.field = shortened(field, _LONGEST_FIELD)
        self.cause = shortened(cause, _LONGEST_CAUSE)
        super().__init__(f"{self.field}: {self.cause}")

    def __reduce__(self) -> tuple[type[MalformedMessageError], tuple[str, str]]:
        """Let the error cross from one process to another."""
        return type(self), (self.field, self.cause)
