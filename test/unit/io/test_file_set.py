"""Files that belong together are replaced together, whenever whoever does it is killed."""

import os
import sys
from pathlib import Path

import pytest

from usmap_ros.io.file_set import replace_files

NAMES = ("map.npz", "map.pgm", "map.yaml", "summary.json")
#: What changes a folder, by the names of Python's audit events.
CHANGES = ("os.rename", "os.link", "os.symlink", "os.remove", "os.mkdir", "os.rmdir", "open")
KILLED = 9


def contents(version: str, names: tuple[str, ...] = NAMES) -> dict[str, bytes]:
    return {name: f"{version} of {name}".encode() for name in names}


def versions(folder: Path) -> set[str]:
    """What versions the files are of that are there."""
    return {(folder / name).read_text().split()[0] for name in NAMES if (folder / name).exists()}


def replace_until_killed(folder: Path, steps: int, version: str, names: tuple[str, ...]) -> int:
    """Replace in a process that dies before its change number `steps`; its exit status."""
    child = os.fork()
    if not child:
        count = 0

        def watch(event: str, _: object) -> None:
            nonlocal count
            count += event in CHANGES
            if count > steps:
                os._exit(KILLED)

        sys.addaudithook(watch)
        replace_files(folder, contents(version, names), gone=NAMES)
        os._exit(0)
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])


@pytest.mark.skipif(not hasattr(os, "fork"), reason="kills a process that it forks")
@pytest.mark.parametrize("names", [NAMES, NAMES[:3]], ids=["all", "without a summary"])
def test_a_kill_at_any_step_leaves_all_old_or_all_new_ones(
    tmp_path: Path, names: tuple[str, ...]
) -> None:
    replace_files(tmp_path, contents("v0"))
    seen, version = set(), "v0"
    for steps in range(200):
        # Not from the start each time: it goes on from what the one before has left.
        version = f"v{steps + 1}"
        status = replace_until_killed(tmp_path, steps, version, names)
        (found,) = versions(tmp_path)
        present = {name for name in NAMES if (tmp_path / name).exists()}
        assert present >= set(names)
        seen.add(found == version)
        if status == 0:
            break
        assert status == KILLED
    assert (status, found, seen) == (0, version, {True, False})
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(names)
    assert not any(path.is_symlink() for path in tmp_path.iterdir())


def test_other_files_stay_and_a_failure_changes_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    replace_files(tmp_path, contents("old"))
    (tmp_path / "notes.txt").write_text("mine")
    before = sorted(path.name for path in tmp_path.iterdir())

    def no_room(self: Path, content: bytes) -> int:
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(Path, "write_bytes", no_room)
        with pytest.raises(OSError, match="No space"):
            replace_files(tmp_path, contents("new"))
    assert versions(tmp_path) == {"old"}
    assert sorted(path.name for path in tmp_path.iterdir()) == before
    assert (tmp_path / "notes.txt").read_text() == "mine"


def test_without_links_they_are_replaced_one_by_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def no_links(*_: object, **__: object) -> None:
        raise OSError(1, "Operation not permitted")

    monkeypatch.setattr(os, "symlink", no_links)
    monkeypatch.setattr(Path, "symlink_to", no_links)
    replace_files(tmp_path, contents("old"))
    replace_files(tmp_path, contents("new", NAMES[:3]), gone=NAMES)
    assert versions(tmp_path) == {"new"}
    assert not (tmp_path / "summary.json").exists()
