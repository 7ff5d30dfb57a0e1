"""One part of the study: a picture and the numbers behind it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from matplotlib.figure import Figure


@dataclass(frozen=True)
class Part:
    """A picture and the numbers behind it.

    Parameters
    ----------
    name : str
        Stem of the picture's file, and key in ``paper.json``.
    numbers : dict
        What a check can read.
    figure : Figure
        The picture.
    """

    name: str
    numbers: dict[str, Any]
    figure: Figure
