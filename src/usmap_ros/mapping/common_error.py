"""What is wrong with all pings alike, of which nothing shows but in how well their echoes meet."""

from typing import NamedTuple

from usmap_ros.mapping.focus import Ping, from_several_places
from usmap_ros.mapping.pose_delay import PoseTracks, pose_delay_s, with_pose
from usmap_ros.mapping.range_error import RangeError, range_error, with_ranges
from usmap_ros.pings.cone import EchoCone


class CommonError(NamedTuple):
    """What is wrong with all pings."""

    #: What ranges are to be multiplied by, and by how much less they are then, m.
    scale: float = 1.0
    late_m: float = 0.0
    #: By how much poses are told too late, s.
    poses_late_s: float = 0.0

    @property
    def reasons(self) -> list[str]:
        """What is to be said of it; nothing if nothing is wrong."""
        found = []
        if self.scale != 1.0:
            off = 1.0 / self.scale - 1.0
            how = "long: sound is slower" if off > 0.0 else "short: sound is faster"
            found.append(f"all ranges are {abs(off):.1%} too {how} than was stated")
        if self.late_m:
            found.append(f"all ranges are {100.0 * self.late_m:.0f} cm too long: told late")
        if self.poses_late_s:
            how = "late" if self.poses_late_s > 0.0 else "early"
            found.append(f"all poses are {1000.0 * abs(self.poses_late_s):.0f} ms {how}")
        return found


NO_ERROR = CommonError()


def common_error(pings: list[Ping], tracks: PoseTracks) -> CommonError:
    """What is wrong with all pings, if that is sure.

    Parameters
    ----------
    pings : list of (cone, source)
        What was heard, by sensors that report more than the first thing.
    tracks : PoseTracks
        Of them.
    """
    chosen = from_several_places(pings)
    delay_s = pose_delay_s(chosen, tracks)
    late = CommonError(poses_late_s=delay_s)
    there = [(without_error(*ping, late, tracks), ping[1]) for ping in chosen]
    return CommonError(*range_error(there), delay_s)


def without_error(cone: EchoCone, source: str, error: CommonError, tracks: PoseTracks) -> EchoCone:
    """A ping as it would be if nothing were wrong with all.

    Parameters
    ----------
    cone, source
        What was heard, and by whom.
    error : CommonError
        What is wrong.
    tracks : PoseTracks
        Of the pings by which that was found.
    """
    if error.poses_late_s:
        cone = with_pose(cone, tracks.later(cone, source, error.poses_late_s))
    ranges = RangeError(error.scale, error.late_m)
    return cone if ranges == RangeError() else with_ranges(cone, ranges)
