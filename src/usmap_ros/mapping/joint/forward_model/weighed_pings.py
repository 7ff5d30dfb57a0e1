"""What pings said of cells, by parts of them: how much, and from which directions."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from usmap_ros.mapping.joint.forward_model.likelihood_ratios import LikelihoodRatios
from usmap_ros.mapping.joint.visibility.field import Field
from usmap_ros.mapping.ping_table import PingTable, X, Y


class WeighedPings(NamedTuple):
    """What each ping of an area said of its cells."""

    #: The pings, and which of them count how much.
    table: PingTable
    pings: NDArray[np.int64]
    weights: NDArray[np.float32]
    #: The area.
    field: Field
    #: (cells,) int32 array: those of which anything is said, ascending.
    number: NDArray[np.int32]
    #: What groups of the pings said: which of them, and that.
    groups: Sequence[tuple[slice, LikelihoodRatios]]

    def evidence_of_parts(self, part: NDArray[np.int64], parts: int) -> NDArray[np.float32]:
        """What some parts of the pings say of cells, each by itself, (parts, 2, cells).

        Parameters
        ----------
        part : (pings,) integer array
            Which part each ping belongs to.
        parts : int
            How many there are.

        Returns
        -------
        ratios : (parts, 2, cells) float32 array
            Evidence of each cell, and of its block.
        """
        count = len(self.number)
        sums = np.zeros((2, parts * count), np.float32)
        for which, ratios in self.groups:
            rows, end = np.diff(ratios.start), ratios.start[-1]
            places = np.repeat(part[which] * count, rows) + ratios.cell[:end]
            weights = np.repeat(self.weights[which], rows)
            for own, logs in enumerate((ratios.own, ratios.block)):
                sums[own] += np.bincount(places, logs[:end] * weights, parts * count)
        return sums.reshape(2, parts, count).swapaxes(0, 1)

    def aspects_of_parts(self, part: NDArray[np.int64], parts: int) -> NDArray[np.float32]:
        """From where parts of the pings heard cells: what speaks for them, and its direction.

        Parameters
        ----------
        part, parts
            As in `evidence_of_parts`.

        Returns
        -------
        aspects : (parts, 3, cells) float32 array
            Sums of what speaks for the block of each cell, and of the same times the unit vector
            towards the ping, east and north.
        """
        count, step_m = len(self.number), self.field.resolution_m
        rows_and_columns = np.divmod(self.number, self.field.columns)
        x_m, y_m = self.field.geometry().cell_centers_m(*rows_and_columns).T
        sums = np.zeros((3, parts * count), np.float32)
        for which, ratios in self.groups:
            rows, end = np.diff(ratios.start), ratios.start[-1]
            cell, logs = ratios.cell[:end], ratios.block[:end]
            speaks = logs > 0.0
            ping, cell = np.repeat(np.arange(len(rows)), rows)[speaks], cell[speaks]
            numbers = self.table.numbers[self.pings[which]][ping]
            to_x, to_y = numbers[:, X] - x_m[cell], numbers[:, Y] - y_m[cell]
            support = logs[speaks] * self.weights[which][ping]
            by_m = support / np.maximum(np.hypot(to_x, to_y), step_m)
            places = part[which][ping] * count + cell
            for row_of, values in enumerate((support, by_m * to_x, by_m * to_y)):
                sums[row_of] += np.bincount(places, values, parts * count)
        return sums.reshape(3, parts, count).swapaxes(0, 1)
