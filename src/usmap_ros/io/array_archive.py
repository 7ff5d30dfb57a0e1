"""Arrays of an ``.npz`` file that may come from anywhere.

NumPy allocates what a header promises before it looks at what is there, and gives whatever is no
array as bytes.  Here every array is checked against the size of its member before it is read.
"""

import math
import zipfile
import zlib
from collections.abc import Collection
from pathlib import Path
from tokenize import TokenError
from typing import IO, Any

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from usmap_ros.bounds import MAX_ARRAY_BYTES

_PIECE_BYTES = 2**22
#: What zipfile and zlib raise on a damaged archive, beside ValueError.
ARCHIVE_ERRORS = (OSError, EOFError, NotImplementedError, RuntimeError, zipfile.BadZipFile)


def load_arrays(path: Path, names: Collection[str]) -> dict[str, NDArray[Any]]:
    """Those of the named arrays that the archive has.

    Parameters
    ----------
    path : path
        The ``.npz`` file.
    names : collection of str
        Of arrays; whatever else is in the file is not looked at.

    Raises
    ------
    ValueError
        If it is no archive, damaged, or a member is no array of plain values or lies of its size.
    OSError
        If it cannot be read.
    """
    with path.open("rb") as file:
        try:
            with zipfile.ZipFile(file) as archive:
                wanted = {
                    name: member
                    for member in archive.infolist()
                    if (name := member.filename.removesuffix(".npy")) in names
                }
                if sum(member.file_size for member in wanted.values()) > MAX_ARRAY_BYTES:
                    raise ValueError(f"its arrays take more than {MAX_ARRAY_BYTES // 2**20} MiB")
                return {name: _load(archive, name, member) for name, member in wanted.items()}
        except (*ARCHIVE_ERRORS, zlib.error) as error:
            if isinstance(error, OSError) and error.errno is not None:
                raise
            raise ValueError("it is damaged") from error


def array_names(path: Path) -> list[str]:
    """Names of all arrays of an archive that `load_arrays` could open."""
    with zipfile.ZipFile(path) as archive:
        return [name.removesuffix(".npy") for name in archive.namelist()]


def _load(archive: zipfile.ZipFile, name: str, member: zipfile.ZipInfo) -> NDArray[Any]:
    with archive.open(member) as file:
        shape, order, dtype = _header(file, name)
        count = math.prod(shape)
        size = count * dtype.itemsize
        if min(shape, default=0) < 0 or file.tell() + size != member.file_size:
            raise ValueError(f"{name} is not of the size that it says")
        # In pieces: reading all at once would take the room twice.
        content, filled = bytearray(size), 0
        while filled < size and (piece := file.read(min(_PIECE_BYTES, size - filled))):
            content[filled : filled + len(piece)] = piece
            filled += len(piece)
    if filled != size:
        raise ValueError(f"{name} is cut off")
    # A type without a size, such as that of empty texts, has no bytes to count.
    if size == 0:
        return np.zeros(shape, dtype)
    return np.frombuffer(content, dtype).reshape(shape, order="F" if order else "C")


def _header(file: IO[bytes], name: str) -> tuple[tuple[int, ...], bool, np.dtype[Any]]:
    """Shape, whether columns come first, and type of the array that follows."""
    try:
        version = npy.read_magic(file)
        read = npy.read_array_header_1_0 if version == (1, 0) else npy.read_array_header_2_0
        shape, is_by_columns, dtype = read(file)
    except (ValueError, TypeError, AttributeError, SyntaxError, TokenError) as error:
        raise ValueError(f"{name} is no array") from error
    # Python's objects are never unpacked: that would run code.
    if dtype.hasobject or dtype.kind not in "biufcU" or dtype.itemsize > 2**16:
        raise ValueError(f"{name} is no array of numbers or text")
    if dtype.itemsize == 0 and math.prod(shape) > 2**20:
        raise ValueError(f"{name} is not of the size that it says")
    return shape, is_by_columns, dtype


def numbers(
    arrays: dict[str, NDArray[Any]], name: str, dimensions: int, dtype: type[np.generic]
) -> NDArray[Any]:
    """An array of numbers, of so many dimensions, as another type of numbers.

    Raises
    ------
    KeyError
        If there is none of the name.
    ValueError
        If it is none of numbers, has other dimensions, or a number does not fit the type.
    """
    array = arrays[name]
    if array.ndim != dimensions or array.dtype.kind not in "biuf":
        raise ValueError(f"{name} is {array.dtype} {array.shape}")
    if np.issubdtype(dtype, np.integer) and array.dtype.kind == "f":
        raise ValueError(f"{name} is no whole number")
    if issubclass(dtype, np.integer) and array.size:
        bounds = np.iinfo(dtype)
        if not bounds.min <= int(array.min()) <= int(array.max()) <= bounds.max:
            raise ValueError(f"{name} is out of bounds")
    with np.errstate(over="ignore", invalid="ignore"):
        # As large as it is: no copy where none is needed.
        return array.astype(dtype, copy=False)
