"""What a transducer hears of itself in every ping, wherever it is: its ringing, and its mount.

Echoes come from elsewhere in each ping of a robot that moves.  What comes at the same time in all
pings that could hear it, first of all and fainter each time, is the sensor's own.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from usmap_ros.calibration.echo_table import EchoTable, listen
from usmap_ros.calibration.target import WIDEST_OFFSET_M, Target
from usmap_ros.numerics.arrays import BoolArray, FloatArray, IndexArray
from usmap_ros.parameters import ReconstructionParameters, RingingParameters
from usmap_ros.pings.trace import EchoTrace

#: Longest stretch without any, and stretch in which one is in all pings.
_LONGEST_GAP_M, _WIDTH_M = 0.15, 0.01
#: Pings that are needed, how far apart they must have been sent (m), and share, of those that could
#: hear it, that do.
_LEAST_PINGS, _LEAST_WAY_M, _SHARE = 12, 0.2, 0.7
#: Pings in which it is looked for, where nobody asked for it.
_ENOUGH_PINGS = 20
#: It may be heard where it is so many times as loud as what could go unreported.
_HEARD = 1.5
#: Quantile of the pings whose first echo may be the first of it.
_EARLY = 0.25
#: How far a path must be from a straight line, or a circle, for no wall and no object to be always
#: as far away.
_OFF_M = 0.1


@dataclass(frozen=True)
class Ringing:
    """Where it is heard, as recorded."""

    #: (n,) arrays: of echoes that are none.
    ranges_m: FloatArray
    amplitudes: FloatArray

    def accounts_for(self, table: EchoTable) -> BoolArray:
        """Which echoes may be no more than ringing."""
        near = np.abs(table.ranges_m[:, np.newaxis] - self.ranges_m) < 2.0 * _WIDTH_M
        faint = table.amplitudes[:, np.newaxis] <= _HEARD * self.amplitudes
        found: BoolArray = np.any(near & faint, axis=1)
        return found

    @property
    def parameters(self) -> RingingParameters:
        """To reconstruct with."""
        return RingingParameters(
            ranges_m=self.ranges_m.tolist(), amplitudes=self.amplitudes.tolist()
        )


def ringing_of(
    traces: Sequence[EchoTrace],
    parameters: ReconstructionParameters,
    target: Target | None = None,
    *,
    pings: int = _ENOUGH_PINGS,
    nearer_m: float = 0.0,
) -> Ringing | None:
    """What a transducer hears of itself; None: nothing, or that cannot be told.

    Parameters
    ----------
    traces : sequence of EchoTrace
        From places apart.
    parameters : ReconstructionParameters
        What they are reconstructed with.
    target : Target, optional
        An object that is known; its echo ends the search.
    pings : int
        About so many of the traces are looked at.
    nearer_m : float
        How far below the least range of its transducer it is looked for.
    """
    if len(traces) < _LEAST_PINGS or len({trace.child_frame_id for trace in traces}) > 1:
        return None
    table = listen(traces[:: max(1, len(traces) // pings)], parameters, nearer_m)
    if table is None or not len(table.ranges_m):
        return None
    ringing = find_ringing(table, target)
    return ringing if len(ringing.ranges_m) else None


def find_ringing(table: EchoTable, target: Target | None = None) -> Ringing:
    """Find what comes at the same time in all pings.

    An object that the robot goes round is always as far away too: the target tells it apart, or a
    path that no object could be always as far from.

    Parameters
    ----------
    table : EchoTable
        All echoes, of one transducer.
    target : Target, optional
        An object that is known; its echo ends the search.
    """
    ranges_m: list[float] = []
    amplitudes: list[float] = []
    first_m = table.ranges_m[np.unique(table.pings, return_index=True)[1]]
    last_m = float(np.quantile(first_m, _EARLY)) - _WIDTH_M
    while True:
        found = _next(table, last_m, amplitudes[-1] if amplitudes else np.inf)
        if found is None or _is_an_object(table, found, target):
            return Ringing(np.array(ranges_m), np.array(amplitudes))
        ranges_m.append(float(np.median(table.ranges_m[found])))
        amplitudes.append(float(np.median(table.amplitudes[found])))
        last_m = ranges_m[-1] + _WIDTH_M


def _is_an_object(table: EchoTable, members: IndexArray, target: Target | None) -> bool:
    """Whether echoes that are always as far away may come from something that is so, too."""
    range_m = float(np.median(table.ranges_m[members]))
    if target is None:
        return could_stand_as_far(table.positions_m[table.pings[members]], range_m)
    offset_m = table.positions_m[table.pings[members]] - (target.x_m, target.y_m)
    away_m = np.hypot(*offset_m.T) - target.radius_m
    is_near = abs(float(np.median(table.ranges_m[members] - away_m))) < WIDEST_OFFSET_M
    return is_near and float(np.std(away_m)) < _WIDTH_M


def could_stand_as_far(positions_m: FloatArray, range_m: float, off_m: float = _OFF_M) -> bool:
    """Whether a wall along a path, or an object in its middle, would be always as far away.

    Parameters
    ----------
    positions_m : (n, 2) array
        Where pings were sent from.
    range_m : float
        How far away it was heard.
    off_m : float
        RMS of how far from a line, or a circle, the path must be for neither.
    """
    from_mean_m = positions_m - positions_m.mean(axis=0)
    across_m = from_mean_m @ np.linalg.svd(from_mean_m, full_matrices=False)[2][-1]
    if float(np.std(across_m)) < off_m:
        return True
    # A circle by least squares (Kåsa, 1976): 2 c·p + k = |p|², with k = R² − |c|².
    columns = np.column_stack([2.0 * from_mean_m, np.ones(len(from_mean_m))])
    centre_and_k = np.linalg.lstsq(columns, np.sum(from_mean_m**2, axis=1), rcond=None)[0]
    away_m = np.hypot(*(from_mean_m - centre_and_k[:2]).T)
    is_round = float(np.std(away_m)) < off_m
    return is_round and float(np.mean(away_m)) < range_m + WIDEST_OFFSET_M


def _next(table: EchoTable, last_m: float, loudest: float) -> IndexArray | None:
    """Echoes at the next range at which all pings have one."""
    near = np.flatnonzero(
        (table.ranges_m > last_m)
        & (table.ranges_m < last_m + _LONGEST_GAP_M)
        & (table.amplitudes < loudest)
    )
    for begin_m in np.sort(table.ranges_m[near]):
        offset_m = table.ranges_m[near] - begin_m
        members: IndexArray = near[(offset_m >= 0.0) & (offset_m < _WIDTH_M)]
        if _is_everywhere(table, members):
            return members
    return None


def _is_everywhere(table: EchoTable, members: IndexArray) -> bool:
    """Whether echoes are in most pings that could hear them, from different places."""
    pings = np.unique(table.pings[members])
    if len(pings) < _LEAST_PINGS:
        return False
    if np.ptp(table.positions_m[pings], axis=0).max() < _LEAST_WAY_M:
        return False
    range_m, amplitude = (
        float(np.median(column[members])) for column in (table.ranges_m, table.amplitudes)
    )
    could = sum(amplitude > _HEARD * table.limit(ping, range_m) for ping in range(table.ping_count))
    return len(pings) >= _SHARE * max(could, len(pings))
