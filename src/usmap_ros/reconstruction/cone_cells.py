"""The cells of a grid that lie in a sensing cone."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from usmap_ros.acoustics.transducer import Transducer
from usmap_ros.numerics.arrays import FloatArray, IndexArray
from usmap_ros.numerics.geometry import Pose, at_height


@dataclass(frozen=True)
class ConeCells:
    """Cells of a grid whose centres lie in a sensing cone, by ascending range."""

    #: Side of a cell; cell (row, column) covers y from ``row * resolution_m`` and x from
    #: ``column * resolution_m`` in the world frame.
    resolution_m: float
    #: (cells,) integer arrays: which cells they are.
    rows: IndexArray
    columns: IndexArray
    #: (cells,) arrays: of their centres, from the transducer and off its axis.
    ranges_m: FloatArray
    bearings_rad: FloatArray
    #: (cells,) arrays: of the beam.
    gains: FloatArray
    #: At which an object in them is taken to be.
    height_m: float = 0.0

    def __len__(self) -> int:
        return len(self.rows)

    @property
    def places(self) -> IndexArray:
        """Row and column of every cell, shape (cells, 2)."""
        return np.stack([self.rows, self.columns], axis=-1)

    @property
    def centers_m(self) -> FloatArray:
        """Centres in the world frame, shape (cells, 2)."""
        places = np.stack([self.columns, self.rows], axis=-1).astype(float)
        return (places + 0.5) * self.resolution_m

    @property
    def points_m(self) -> FloatArray:
        """Where objects in them are taken to be, shape (cells, 3)."""
        return at_height(self.centers_m, self.height_m)

    @classmethod
    def seen(
        cls, pose: Pose, transducer: Transducer, resolution_m: float, rise_m: float = 0.0
    ) -> ConeCells:
        """Cells within the range limits of a transducer that its beam reaches.

        Parameters
        ----------
        pose : Pose
            Of the transducer, tilted or not.
        transducer : Transducer
            Its beam and range limits.
        resolution_m : float
            Side of a cell.
        rise_m : float
            Height of the objects in the cells above the transducer.
        """
        x_m, y_m = pose.position_m[:2]
        reach = transducer.max_range_m / resolution_m + 1.0
        first_column, first_row = np.floor(np.array([x_m, y_m]) / resolution_m - reach).astype(int)
        side = np.arange(2 * int(np.ceil(reach)) + 2)
        row, column = (grid.reshape(-1) for grid in np.meshgrid(side, side, indexing="ij"))
        row, column = row + first_row, column + first_column
        centers_m = (np.stack([column, row], axis=-1) + 0.5) * resolution_m
        height_m = float(pose.position_m[2]) + rise_m
        range_m, bearing = pose.polar(at_height(centers_m, height_m))
        gain = transducer.beam.gain(bearing)
        seen = (range_m >= transducer.min_range_m) & (range_m <= transducer.max_range_m)
        inside = np.flatnonzero(seen & (gain > 0.0) & (range_m > 0.0))
        order = inside[np.lexsort((bearing[inside], range_m[inside]))]
        return cls(
            resolution_m,
            row[order],
            column[order],
            range_m[order],
            bearing[order],
            gain[order],
            height_m,
        )
