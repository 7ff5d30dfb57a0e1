"""Which pings go where more come than can be explained: those that stay are spread over all."""

import numpy as np

from usmap_ros.numerics.arrays import IndexArray


class Thinning:
    """Thins a row of pings again and again, so that of each time as large a share stays."""

    def __init__(self) -> None:
        # So many of the oldest are left of those that came, and such a share of these.
        self._oldest, self._share = 0, 1.0

    def going(self, pings: int) -> IndexArray:
        """Choose who goes, and take it that they do.

        Parameters
        ----------
        pings : int
            How many there are; those that came since the last time are the newest.

        Returns
        -------
        indices : (n,) integer array
            Which go, in ascending order.
        """
        # Of the newest all are there still: they go until what is left of older ones fills half.
        share = self._share if 0 < 2 * self._oldest <= pings else 0.5 * self._share
        stays = np.full(pings, share)
        stays[: self._oldest] = share / self._share
        # At random, for robots take turns: every second ping may be one robot's.
        goes = np.flatnonzero(np.random.default_rng(pings).random(pings) >= stays)
        self._oldest, self._share = pings - len(goes), share
        return goes

    def let_go(self, oldest: int) -> None:
        """Note that some of the oldest have gone for other reasons."""
        self._oldest = max(self._oldest - oldest, 0)
        if not self._oldest:
            self._share = 1.0
