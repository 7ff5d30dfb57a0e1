"""Key pings: so few that each place is still looked at often enough from each side.

Where robots go round and round, most pings say again what others said.  Until it is settled what
hides what, those that add looks are enough; then all count.
"""

import numpy as np
from numpy.typing import NDArray

from usmap_ros.mapping.joint.looks import Looks
from usmap_ros.mapping.ping_table import PingTable


def key_pings(
    table: PingTable, pings: NDArray[np.int64], weights: NDArray[np.float32]
) -> NDArray[np.int64]:
    """Places of pings that together look at everything often enough.

    Parameters
    ----------
    table : PingTable
        Pings.
    pings : (pings,) integer array
        Rows of those that count.
    weights : (pings,) float32 array
        How many looks each is.

    Returns
    -------
    chosen : (key pings,) integer array
        Which of them, in their order.
    """
    numbers = table.numbers[pings]
    are_chosen, _ = Looks.of_none(numbers).of_lacking(numbers, weights, _spread(len(pings)))
    return np.flatnonzero(are_chosen)


def _spread(count: int) -> NDArray[np.int64]:
    """Numbers up to a count, such that the first ones are spread evenly over all."""
    bits = max(1, (count - 1).bit_length())
    turned = [int(f"{number:0{bits}b}"[::-1], 2) for number in range(1 << bits)]
    return np.array([number for number in turned if number < count], np.int64)
