"""What commands say on standard error, and the tables they print on standard output."""

import logging
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager


def print_error(message: str) -> None:
    """Print an error, in one line."""
    _print_line("error", message)


def set_up_logging(verbosity: int) -> None:
    """Print warnings of usmap_ros as ``usmap: warning: …``, and more if `verbosity` is above 0."""
    logger = logging.getLogger("usmap_ros")
    logger.setLevel({0: logging.WARNING, 1: logging.INFO}.get(verbosity, logging.DEBUG))
    logger.propagate = False
    logger.handlers = [_LineHandler()]


class _LineHandler(logging.Handler):
    """Prints every record in one line, above the progress bar if there is one."""

    def emit(self, record: logging.LogRecord) -> None:
        """Print a record."""
        _print_line(record.levelname.lower(), record.getMessage())


def _print_line(kind: str, message: str) -> None:
    # sys.stderr is looked up each time: a progress bar replaces it while it is shown.
    print(f"usmap: {kind}: {' '.join(message.split())}", file=sys.stderr)


def compile_loops(*, everything: bool = False) -> None:
    """Compile the inner loops if that was not done before, and say so.

    Parameters
    ----------
    everything : bool
        Also those that few need.
    """
    from usmap_ros.numerics.compiled import begin_without_blas
    from usmap_ros.runs.compilation import compile_if_needed
    from usmap_ros.runs.small_session import ALL, SESSION

    parts = ALL if everything else SESSION
    compile_if_needed(lambda line: print(f"usmap: {line}", file=sys.stderr), parts)
    begin_without_blas()


@contextmanager
def progress(description: str, total: int | None = None) -> Iterator[Callable[[], None]]:
    """Show a progress bar if somebody is watching; gives the function that advances it.

    It is drawn on standard error, so that standard output can be piped on, and vanishes at the
    end.
    """
    if not sys.stderr.isatty():
        yield lambda: None
        return
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TextColumn,
        TimeRemainingColumn,
    )

    bar = Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeRemainingColumn(),
        console=Console(stderr=True),
        transient=True,
    )
    with bar:
        task = bar.add_task(description, total=total)
        yield lambda: bar.advance(task)


def print_table(title: str, columns: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """Print a table on standard output; all columns but the first are aligned right.

    Where the terminal is too narrow, the first column is folded, and the others never are.
    """
    from rich import box
    from rich.console import Console
    from rich.table import Table

    table = Table(title=title, title_justify="left", box=box.SIMPLE, pad_edge=False)
    for number, column in enumerate(columns):
        table.add_column(
            column, justify="right" if number else "left", overflow="fold", no_wrap=number > 0
        )
    for row in rows:
        table.add_row(*row)
    # A file or a pipe has no width: there nothing is folded.
    width = None if sys.stdout.isatty() else 200
    Console(width=width, highlight=False, markup=False).print(table)


def print_facts(title: str, facts: Mapping[str, str]) -> None:
    """Print names and values in two columns on standard output."""
    from rich.console import Console
    from rich.table import Table

    table = Table.grid(padding=(0, 2))
    for name, value in facts.items():
        table.add_row(name, value)
    width = None if sys.stdout.isatty() else 200
    console = Console(width=width, highlight=False, markup=False, soft_wrap=True)
    console.print(title, style="bold")
    console.print(table)
