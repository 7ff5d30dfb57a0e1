"""One part of the study: a picture and the numbers behind it."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.figure import Figure


@dataclass(frozen=True)
class Part:
    """A picture and the numbers behind it."""

    #: Stem of the picture's file, and key in ``paper.json``.
    name: str
    #: What a check can read.
    numbers: dict[str, Any]
    figure: Figure


def statement(holds: bool | np.bool_, **numbers: Any) -> dict[str, Any]:
    """One thing that a caption of the paper says, for ``paper.json``.

    Parameters
    ----------
    holds : bool
        Whether it came out so.
    **numbers
        What it was judged by.
    """
    return {"holds": bool(holds), **numbers}
