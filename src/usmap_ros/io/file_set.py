"""Files of a folder that belong together, replaced all at once.

Each file alone can be replaced in one step, several cannot: whoever is killed in between leaves
a new image beside an old description.  So, for the moment of the exchange, the files become
symbolic links that all lead through one more link to the folder of the old ones or of the new
ones.  Replacing that one link is the step that counts: before and after it every name leads to
the same content as all others.  At rest, the files are plain.
"""

import os
import shutil
import tempfile
from collections.abc import Iterable, Mapping
from contextlib import suppress
from pathlib import Path
from threading import Lock

from usmap_ros.io.atomic import usual_mode, write_atomically

#: The link that all of them lead through, and how the names of everything else begin that is there
#: for the moment only.
_GATE, _PASSING = ".usmap-set", ".usmap-set-"
#: Two threads of a node may keep their maps in one folder.
_one_at_a_time = Lock()


def replace_files(folder: Path, contents: Mapping[str, bytes], gone: Iterable[str] = ()) -> None:
    """Replace files of a folder, so that it never holds some old and some new ones.

    Where there are no symbolic links, as on some network drives, they are replaced one after the
    other, in the order of `contents`.

    Parameters
    ----------
    folder : path
        Other files in it are left alone.
    contents : mapping of str to bytes
        What each file is to hold, by its name in the folder.
    gone : iterable of str
        Names of files that belong to them and are there no more.

    Raises
    ------
    OSError
        If they cannot be written: what was there before still is.
    """
    with _one_at_a_time:
        old = [name for name in {**contents, **dict.fromkeys(gone)} if (folder / name).exists()]
        if old and _has_links(folder):
            _exchange(folder, contents, old)
        else:
            # Without old ones there is nothing that the first could contradict.
            for name, content in contents.items():
                write_atomically(folder / name, content)
        for name in set(gone) - set(contents):
            (folder / name).unlink(missing_ok=True)
        _clear_away(folder)


def _has_links(folder: Path) -> bool:
    try:
        _link("nowhere", folder / f"{_PASSING}probe")
    except (OSError, NotImplementedError):
        return False
    return True


def _exchange(folder: Path, contents: Mapping[str, bytes], old: list[str]) -> None:
    try:
        before, after = (Path(tempfile.mkdtemp(prefix=_PASSING, dir=folder)) for _ in range(2))
        for name, content in contents.items():
            (after / name).write_bytes(content)
            (after / name).chmod(usual_mode())
        for name in old:
            _same(folder / name, before / name)
        # If somebody was killed here before, they are links already, to the same content.
        _link(before.name, folder / _GATE)
        for name in {*contents, *old}:
            _link(f"{_GATE}/{name}", folder / name)
        _link(after.name, folder / _GATE)
    except OSError:
        _clear_away(folder)
        raise
    for name in contents:
        plain = folder / f"{_PASSING}{name}"
        plain.unlink(missing_ok=True)
        _same(after / name, plain)
        plain.replace(folder / name)


def _same(file: Path, name: Path) -> None:
    """Give what a name leads to another name."""
    content = file.resolve()
    try:
        os.link(content, name)
    except OSError:
        shutil.copy2(content, name)


def _link(target: str, name: Path) -> None:
    """Let a name lead to a target, whatever it was before, in one step."""
    passing = name.with_name(f"{_PASSING}link")
    passing.unlink(missing_ok=True)
    passing.symlink_to(target)
    passing.replace(name)


def _clear_away(folder: Path) -> None:
    """Remove what was there for the moment, unless a name still leads through it."""
    with suppress(OSError):
        used = ""
        if any(entry.is_symlink() and _leads_through(entry) for entry in folder.iterdir()):
            used = os.readlink(folder / _GATE)
        else:
            (folder / _GATE).unlink(missing_ok=True)
        for entry in folder.glob(f"{_PASSING}*"):
            if entry.is_symlink() or entry.is_file():
                entry.unlink(missing_ok=True)
            elif entry.name != used:
                shutil.rmtree(entry, ignore_errors=True)


def _leads_through(entry: Path) -> bool:
    return os.readlink(entry).startswith(f"{_GATE}/")
