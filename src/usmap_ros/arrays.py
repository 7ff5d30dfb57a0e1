"""Types of arrays, under one name each."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
#: Of single or double precision.
RealArray = NDArray[np.floating[Any]]
BoolArray = NDArray[np.bool_]
#: Integers of any meaning, and those that NumPy indexes with.
IntArray = NDArray[np.int64]
IndexArray = NDArray[np.intp]
#: Signals and their coefficients, real or complex.
Signal = NDArray[Any]
