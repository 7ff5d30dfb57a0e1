"""Where robots went while they pinged, and what they looked at from there."""

from __future__ import annotations

import math
from array import array
from collections.abc import Mapping, Sequence

import numpy as np

from usmap_ros.numerics.arrays import FloatArray
from usmap_ros.pings.fields_of_view import Beam, PingViews

_UNKNOWN_BEAM = (math.nan,) * len(Beam._fields)


class RobotPaths:
    """Where each transducer was at its pings and what it looked at, at 40 bytes a ping.

    For pictures of the map, and to judge whether what it calls free can have been seen.

    Parameters
    ----------
    positions_m : mapping of str to sequence of (x, y), optional
        By topic, in the order of stamps; what was looked at from there is not known.
    """

    def __init__(self, positions_m: Mapping[str, Sequence[tuple[float, float]]] | None = None):
        # x, y, and the three numbers of the beam, one ping behind the other.
        self._rows: dict[str, array[float]] = {}
        for topic, positions in (positions_m or {}).items():
            self._rows[topic] = array("d")
            for x_m, y_m in positions:
                self.add(topic, x_m, y_m)

    # It changes: Python says so by None, for which typeshed's `object` has no room.
    __hash__ = None  # type: ignore[assignment]

    def __eq__(self, other: object) -> bool:
        """Whether all pings of all topics are the same."""
        if not isinstance(other, RobotPaths):
            return NotImplemented
        return self._rows.keys() == other._rows.keys() and all(
            np.array_equal(rows, other._rows[topic], equal_nan=True)
            for topic, rows in self._rows.items()
        )

    def add(self, topic: str, x_m: float, y_m: float, beam: Beam | None = None) -> None:
        """Append a ping."""
        self._rows.setdefault(topic, array("d")).extend((x_m, y_m, *(beam or _UNKNOWN_BEAM)))

    def add_all(self, topic: str, positions_m: FloatArray, beams: FloatArray) -> None:
        """Append pings: positions, (n, 2), and numbers of beams, (n, 3), known or all NaN."""
        table = np.concatenate([positions_m, beams], axis=1)
        self._rows.setdefault(topic, array("d")).frombytes(table.astype(np.float64).tobytes())

    def extend(self, other: RobotPaths) -> None:
        """Append the pings of other paths."""
        for topic, rows in other._rows.items():
            self._rows.setdefault(topic, array("d")).extend(rows)

    @property
    def positions_m(self) -> dict[str, FloatArray]:
        """x, y of each ping, shape (pings, 2), by topic."""
        return {topic: self._table(topic)[:, :2] for topic in self._rows}

    @property
    def beams(self) -> dict[str, FloatArray]:
        """Numbers of each ping's `Beam`, shape (pings, 3), by topic; NaN where they are unknown."""
        return {topic: self._table(topic)[:, 2:] for topic in self._rows}

    def _table(self, topic: str) -> FloatArray:
        # A copy: while there is a view, no ping can be appended.
        return np.array(self._rows[topic], dtype=np.float64).reshape(-1, 2 + len(Beam._fields))

    def views(self, max_range_m: float | None = None) -> PingViews | None:
        """What the pings of all topics looked at; None if that is not known of all of them.

        Parameters
        ----------
        max_range_m : float, optional
            How far those reached, all around, of which only the position is known.
        """
        table = np.concatenate([np.zeros((0, 5)), *(self._table(topic) for topic in self._rows)])
        beams = table[:, 2:]
        unknown = np.isnan(beams).any(axis=1)
        if max_range_m is not None:
            beams[unknown] = (0.0, math.pi, max_range_m)
        elif unknown.any():
            return None
        return PingViews(table[:, :2], beams) if len(table) else None
