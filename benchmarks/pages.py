"""Parts of pages that benchmarks write, each between two comments that bear its name."""

from __future__ import annotations

import shlex
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path


def measured() -> str:
    """Say of which commit something is measured, and of what day that is; empty if nobody knows."""
    command = ["git", "log", "-1", "--format=%h of %cs"]
    try:
        done = subprocess.run(
            command, cwd=Path(__file__).parent, capture_output=True, text=True, check=False
        )
    except OSError:
        return ""
    return f"Measured with commit {done.stdout.strip()}.\n" if done.returncode == 0 else ""


def put(page: Path, name: str, text: str) -> None:
    """Put a text into its place on a page, with the commit that it was measured with.

    Parameters
    ----------
    page : path
        In Markdown; has the lines ``<!-- NAME -->`` and ``<!-- /NAME -->``.
    name : str
        Of the place.
    text : str
        What is to stand there instead of what does.

    Raises
    ------
    ValueError
        If the page has no such place.
    """
    start, end = f"<!-- {name} -->\n", f"<!-- /{name} -->"
    before, opened, rest = page.read_text(encoding="utf-8").partition(start)
    _, closed, after = rest.partition(end)
    if not (opened and closed):
        raise ValueError(f"{page} has no place between {start.strip()} and {end}")
    said = "\n" + measured() if measured() else ""
    page.write_text(f"{before}{start}{text}{said}{end}{after}", encoding="utf-8")


def put_with_picture(
    page: Path, name: str, text: str, caption: str, draw: Callable[[Path], None]
) -> None:
    """Put the command that made a text, the text, and its picture into their place on a page.

    Parameters
    ----------
    page, name, text
        As for `put`.
    caption : str
        Of the picture, for those who do not see it.
    draw : callable
        Writes the picture.
    """
    picture = page.parent / "images" / f"{name}.png"
    draw(picture)
    command = shlex.join(["python", f"benchmarks/{Path(sys.argv[0]).name}", *_arguments()])
    shown = f"![{caption}](images/{picture.name})"
    put(page, name, f"\n    {command}\n\n{shown}\n\n{text}\n")


def _arguments() -> list[str]:
    """The command's arguments, but for folders of whoever gave it."""
    kept, skip = [], False
    for argument in sys.argv[1:]:
        if skip or argument in ("--cache", "-o", "--output"):
            skip = not skip
        else:
            kept.append(argument)
    return kept
