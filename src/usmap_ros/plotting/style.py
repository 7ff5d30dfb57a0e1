"""The look that all pictures share, and how they are written to files."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import matplotlib as mpl
from matplotlib.artist import Artist
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure

from usmap_ros.errors import FileError, file_errors

INK = "#22303c"
FAINT = "#8a97a3"
GRID = "#e3e8ec"
UNKNOWN = "#dfe5ea"
SIGNAL = "#5b7fa3"
RECONSTRUCTION = "#e07a1f"
RESIDUAL = "#7d5ba6"
LIMIT = "#3a9d6e"
TRUTH = "#00a37a"
#: Of robots, in turn: mostly from the palette of Okabe and Ito, whose green is the truth's.
ROBOTS = ("#0072b2", "#d55e00", "#8a5fbf", "#e69f00", "#56b4e9", "#cc79a7", "#5c6b73", "#8c5a2b")

#: Probability of being occupied: free is paper, occupied is ink, doubt is warm.
PROBABILITY = LinearSegmentedColormap.from_list(
    "probability",
    [(0.0, "#ffffff"), (0.35, "#fbe9cf"), (0.5, "#f4b860"), (0.65, "#d1495b"), (1.0, "#1d1135")],
).with_extremes(bad=UNKNOWN)

#: How likely a cell is the source of an echo.
LIKELIHOOD = LinearSegmentedColormap.from_list(
    "likelihood", ["#fdf3e3", "#f9c784", "#ee7b30", "#b3305c", "#2b1247"]
)

#: How undecided a cell is: what is decided is paper.
AMBIGUITY = LinearSegmentedColormap.from_list(
    "ambiguity", ["#ffffff", "#d9d2ec", "#9b7fc4", "#5e3a9b", "#2b1247"]
).with_extremes(bad=UNKNOWN)

# Any: the type that matplotlib wants spells out all its settings.
_STYLE: Any = {
    "font.size": 9.0,
    "axes.titlesize": 10.0,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.labelcolor": INK,
    "axes.titlecolor": INK,
    "axes.edgecolor": FAINT,
    "axes.linewidth": 0.8,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": GRID,
    "grid.linewidth": 0.8,
    "xtick.color": FAINT,
    "ytick.color": FAINT,
    "xtick.labelcolor": INK,
    "ytick.labelcolor": INK,
    "text.color": INK,
    "legend.frameon": True,
    "legend.framealpha": 0.85,
    "legend.edgecolor": "none",
    "legend.fancybox": False,
    "legend.fontsize": 8.0,
    "lines.linewidth": 1.2,
    "figure.facecolor": "white",
    "savefig.facecolor": "white",
    # Identifiers in an SVG would differ from run to run.
    "svg.hashsalt": "usmap",
}
_DOTS_PER_INCH = 160


@contextmanager
def styled() -> Iterator[None]:
    """Apply the style to what is made in the block, and to nothing else."""
    with mpl.rc_context(_STYLE):
        yield


def robot_color(number: int) -> str:
    """Colour of a robot; they come round again after the last."""
    return ROBOTS[number % len(ROBOTS)]


def new_figure(width_in: float, height_in: float, dots_per_inch: float = _DOTS_PER_INCH) -> Figure:
    """Make an empty figure that lays itself out."""
    figure = Figure(figsize=(width_in, height_in), dpi=dots_per_inch, layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def legend_below(
    figure: Figure, handles: Sequence[Artist], labels: Sequence[str], columns: int
) -> None:
    """Put a legend below all axes of a figure, in room that is kept for it.

    Parameters
    ----------
    figure : matplotlib.figure.Figure
        As `new_figure` makes them.
    handles, labels : sequence of Artist, sequence of str
        What is explained.
    columns : int
        Most entries in a row.
    """
    columns = min(columns, len(labels))
    rows = -(-len(labels) // columns)
    share = (1.6 * rows + 1.0) * _STYLE["legend.fontsize"] / (72.0 * figure.get_figheight())
    figure.set_layout_engine("constrained", rect=(0.0, share, 1.0, 1.0 - share))
    legend = figure.legend(
        handles, labels, loc="lower center", ncols=columns, handlelength=1.4, columnspacing=1.2,
        borderaxespad=0.2,
    )  # fmt: skip
    # Its room is set aside already.
    legend.set_in_layout(False)


def counted(number: int, singular: str, plural: str) -> str:
    """Put a number before what is counted."""
    return f"{number} {singular if number == 1 else plural}"


def save_figure(figure: Figure, path: Path) -> None:
    """Write a figure; the suffix chooses the format.

    Raises
    ------
    FileError
        If there is no such format, or the file cannot be written.
    """
    formats = figure.canvas.get_supported_filetypes()
    suffix = path.suffix.lstrip(".").lower()
    if suffix not in formats:
        known = ", ".join(f".{name}" for name in ("png", "pdf", "svg", "jpg"))
        raise FileError(path, f"has a suffix that is no kind of picture; use one of {known}")
    # Without these, the same picture would differ from run to run.
    metadata = {"png": {"Software": None}, "pdf": {"CreationDate": None}, "svg": {"Date": None}}
    with file_errors(FileError, path), styled():
        engine = figure.get_layout_engine()
        if suffix == "png" and engine is not None and figure.axes:
            # Matplotlib would draw all of it once to lay it out, and once more.
            engine.execute(figure)
            figure.set_layout_engine("none")
        figure.savefig(path, metadata=metadata.get(suffix))
