"""The errors that usmap_ros raises for unusable data, all under one root.

Each message is one line that a user can act on: it names the file or message, the field
where there is one, and the cause.  The command line prints it behind ``usmap: error:``.
"""

from __future__ import annotations

from pathlib import Path


class UsmapError(Exception):
    """Root of every error that bad input can cause."""


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
        super().__init__(f"{path}: {cause}")
        self.path = Path(path)
        self.cause = cause


class BagError(FileError):
    """A recording that cannot be read or written."""


class MapFileError(FileError):
    """A map file that cannot be read or written."""


class ConfigurationError(FileError):
    """A YAML file with an unknown key or a value out of range."""


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
        super().__init__(f"{field}: {cause}")
        self.field = field
        self.cause = cause

    def __reduce__(self) -> tuple[type[MalformedMessageError], tuple[str, str]]:
        """Let the error cross from one process to another."""
        return type(self), (self.field, self.cause)
