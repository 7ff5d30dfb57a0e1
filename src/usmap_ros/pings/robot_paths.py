"""Where robots went while they pinged, and what they looked at from there."""

from __future__ import annotations

import math
from array import array
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from usmap_ros.numerics.arrays import FloatArray
from usmap_ros.pings.fields_of_view import Beam, PingViews
from usmap_ros.pings.trajectory import Trajectory

_UNKNOWN_BEAM = (math.nan,) * len(Beam._fields)


class RobotPaths:
    """Where each transducer was at its pings and what it looked at, at 48 bytes a ping.

    For pictures of the map, and to judge whether what it calls free can have been seen.

    Parameters
    ----------
    positions_m : mapping of str to sequence of (x, y), optional
        By topic, in the order of stamps; what was looked at from there is not known.
    """

    def __init__(self, positions_m: Mapping[str, Sequence[tuple[float, float]]] | None = None):
        # x, y, and the three numbers of the beam, one ping behind the other.
        self._rows: dict[str, array[float]] = {}
        self._stamps_ns: dict[str, array[int]] = {}
        for topic, positions in (positions_m or {}).items():
            self._rows[topic], self._stamps_ns[topic] = array("d"), array("q")
            for x_m, y_m in positions:
                self.add(topic, x_m, y_m)

    # It changes: Python says so by None, for which typeshed's `object` has no room.
    __hash__ = None  # type: ignore[assignment]

    def __eq__(self, other: object) -> bool:
        """Whether all pings of all topics are the same."""
        if not isinstance(other, RobotPaths):
            return NotImplemented
        if self._stamps_ns != other._stamps_ns:
            return False
        return self._rows.keys() == other._rows.keys() and all(
            np.array_equal(rows, other._rows[topic], equal_nan=True)
            for topic, rows in self._rows.items()
        )

    def add(
        self, topic: str, x_m: float, y_m: float, beam: Beam | None = None, stamp_ns: int = 0
    ) -> None:
        """Append a ping; a stamp of 0 is not known."""
        self._rows.setdefault(topic, array("d")).extend((x_m, y_m, *(beam or _UNKNOWN_BEAM)))
        self._stamps_ns.setdefault(topic, array("q")).append(stamp_ns)

    def add_all(
        self, topic: str, positions_m: FloatArray, beams: FloatArray, stamps_ns: NDArray[np.int64]
    ) -> None:
        """Append pings: positions, (n, 2), numbers of beams, (n, 3), known or all NaN, stamps."""
        self._stamps_ns.setdefault(topic, array("q")).frombytes(
            stamps_ns.astype(np.int64).tobytes()
        )
        table = np.concatenate([positions_m, beams], axis=1)
        self._rows.setdefault(topic, array("d")).frombytes(table.astype(np.float64).tobytes())

    def extend(self, other: RobotPaths) -> None:
        """Take in the pings of other paths, each topic's in the order of stamps."""
        for topic, rows in other._rows.items():
            self._rows.setdefault(topic, array("d")).extend(rows)
            self._stamps_ns.setdefault(topic, array("q")).extend(other._stamps_ns[topic])
            stamps_ns = np.array(self._stamps_ns[topic], np.int64)
            order = np.argsort(stamps_ns, kind="stable")
            self._rows[topic] = array("d", self._table(topic)[order].tobytes())
            self._stamps_ns[topic] = array("q", stamps_ns[order].tobytes())

    @property
    def positions_m(self) -> dict[str, FloatArray]:
        """x, y of each ping, shape (pings, 2), by topic."""
        return {topic: self._table(topic)[:, :2] for topic in self._rows}

    @property
    def beams(self) -> dict[str, FloatArray]:
        """Numbers of each ping's `Beam`, shape (pings, 3), by topic; NaN where they are unknown."""
        return {topic: self._table(topic)[:, 2:] for topic in self._rows}

    @property
    def stamps_ns(self) -> dict[str, NDArray[np.int64]]:
        """Stamp of each ping, shape (pings,), by topic; 0 where it is not known."""
        return {topic: np.array(stamps, np.int64) for topic, stamps in self._stamps_ns.items()}

    def trajectories(self) -> dict[str, Trajectory]:
        """Poses of each transducer, by topic, as far as stamps and headings are known."""
        found = {}
        for topic, stamps_ns in self.stamps_ns.items():
            poses = self._table(topic)[:, :3]
            known = np.flatnonzero((stamps_ns != 0) & np.isfinite(poses[:, 2]))
            if len(known):
                ordered = known[np.argsort(stamps_ns[known], kind="stable")]
                found[topic] = Trajectory.planar(stamps_ns[ordered], poses[ordered])
        return found

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
