"""Which files a recording consists of, and how they are compressed."""

import logging
import re
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import zstandard

from usmap_ros.errors import BagError, file_errors
from usmap_ros.io.storage.compression import Allowance, TooMuchError
from usmap_ros.io.storage.index import Storage
from usmap_ros.io.storage.mcap_file import McapFile
from usmap_ros.io.storage.sqlite_file import SqliteFile
from usmap_ros.io.yaml_text import parse_yaml

logger = logging.getLogger(__name__)

_STORAGES: dict[str, type[McapFile] | type[SqliteFile]] = {".mcap": McapFile, ".db3": SqliteFile}
_COMPRESSED_SUFFIXES = (".zst", ".zstd")
_PIECE_BYTES = 2**22


@dataclass(frozen=True)
class _Recording:
    """Files of a recording, in the order in which they were written."""

    files: list[Path]
    message_compression: str = ""


def open_storage(path: Path, scratch: TemporaryDirectory[str]) -> list[Storage]:
    """Open all files of a recording.

    Parameters
    ----------
    path : path
        A rosbag2 folder, with or without its ``metadata.yaml``, or one ``.mcap`` or ``.db3``.
    scratch : TemporaryDirectory
        Where files that are compressed as a whole are unpacked.

    Raises
    ------
    BagError
        If there is no recording at `path`.
    """
    if not path.exists():
        raise BagError(path, "does not exist")
    recording = _read_folder(path) if path.is_dir() else _Recording([path])
    return [
        _open_file(file, recording.message_compression, Path(scratch.name))
        for file in recording.files
    ]


def is_recording(path: Path) -> bool:
    """Whether something is a recording by its name, or by the files in it."""
    if not path.is_dir():
        return _is_storage(path)
    try:
        return any(entry.name == "metadata.yaml" or _is_storage(entry) for entry in path.iterdir())
    except OSError:
        return False


def _read_folder(folder: Path) -> _Recording:
    metadata = folder / "metadata.yaml"
    with file_errors(BagError, folder, "read"):
        present = sorted(filter(_is_storage, folder.iterdir()), key=_natural_order)
        if metadata.is_file() and metadata.stat().st_size:
            return _read_metadata(metadata, present)
    if not present:
        raise BagError(folder, "is not a recording: it holds no .mcap or .db3 file")
    logger.warning("%s: has no metadata.yaml, so its recorder was not closed properly", folder)
    return _Recording(present)


def _read_metadata(metadata: Path, present: list[Path]) -> _Recording:
    try:
        content: Any = parse_yaml(metadata.read_text(encoding="utf-8"))
        information = content["rosbag2_bagfile_information"]
        # Old versions prefix the names with the folder's.
        listed = [metadata.parent / Path(name).name for name in information["relative_file_paths"]]
        mode = str(information.get("compression_mode") or "").lower()
        compression = str(information.get("compression_format") or "") if mode == "message" else ""
    except (ValueError, LookupError, TypeError, AttributeError) as error:
        if not present:
            raise BagError(metadata, "is not a rosbag2 metadata file") from error
        logger.warning("%s: is not a rosbag2 metadata file; it is ignored", metadata)
        return _Recording(present)
    if compression not in ("", "zstd"):
        raise BagError(metadata, f"names an unknown compression {compression!r}")
    files = [file for file in listed if file.exists()]
    if not files:
        raise BagError(metadata.parent, "none of the files that its metadata.yaml names is there")
    for file in listed:
        if file not in files:
            logger.warning("%s: is missing, though metadata.yaml names it", file)
    return _Recording(files, compression)


def _open_file(file: Path, message_compression: str, scratch: Path) -> Storage:
    if file.suffix in _COMPRESSED_SUFFIXES and file.with_suffix("").suffix in _STORAGES:
        unpacked = scratch / f"{len(list(scratch.iterdir()))}_{file.with_suffix('').name}"
        _decompress_file(file, unpacked)
        return _STORAGES[unpacked.suffix](unpacked, file, message_compression)
    if file.suffix not in _STORAGES:
        raise BagError(file, "is no recording: neither a rosbag2 folder nor .mcap nor .db3")
    return _STORAGES[file.suffix](file, None, message_compression)


def _decompress_file(file: Path, target: Path) -> None:
    """Unpack a file as far as it goes; the storage will notice if it is cut off."""
    allowance = Allowance(file.stat().st_size)
    with file.open("rb") as packed, target.open("wb") as unpacked:
        try:
            with zstandard.ZstdDecompressor().stream_reader(packed) as content:
                while piece := content.read(_PIECE_BYTES):
                    allowance.take(len(piece))
                    unpacked.write(piece)
        except (zstandard.ZstdError, TooMuchError) as error:
            logger.warning("%s: is damaged (%s)", file, error)


def _is_storage(file: Path) -> bool:
    name = file.with_suffix("") if file.suffix in _COMPRESSED_SUFFIXES else file
    return name.suffix in _STORAGES and file.is_file()


def _natural_order(file: Path) -> list[tuple[int, str]]:
    """Sorting key that puts bag_10 behind bag_9."""
    return [(int(digits or 0), text) for digits, text in re.findall(r"(\d*)(\D*)", file.name)]
