"""Whether a robot that landmarks accuse is where it says by the map that all others make.

Landmarks are few, and walls that reverberate show some that are none; a map is of all echoes.
"""

from collections.abc import Sequence

import numpy as np

from usmap_ros.mapping.joint.leave_one_out import LeaveOneOutMap
from usmap_ros.mapping.pose_delay import PoseTracks, with_pose
from usmap_ros.mapping.range_error import RangeError, with_ranges
from usmap_ros.mapping.robot_check.agreement import LEAST_PINGS, Agreement, agreement
from usmap_ros.mapping.robot_check.finding import Finding
from usmap_ros.pings.cone import EchoCone

#: Share of what the map expects that is heard, and `Agreement.fit`, from which on a robot is there:
#: of 89 that were turned, late or moved four came to both, of five healthy ones that were accused
#: four did.
HEARD_MOSTLY, FITS = 0.5, 0.2
#: Share of the fit without what it is accused of, below which it is not there.
FITS_AS_WELL = 0.5


def is_there(cones: Sequence[EchoCone], apart: LeaveOneOutMap, accused: Finding) -> bool:
    """Whether a robot hears most of what the others' map expects, and no better if it is wrong.

    Parameters
    ----------
    cones : sequence of EchoCone
        Its latest pings.
    apart : LeaveOneOutMap
        Of the pings of others that nobody accuses.
    accused : Finding
        What may be wrong with it, of a `Displacement`.
    """

    def compared(pings: Sequence[EchoCone]) -> Agreement:
        return agreement(apart.expected({"": pings})[""])

    told = compared(cones)
    hears = told.audible >= LEAST_PINGS and told.heard >= HEARD_MOSTLY * told.audible
    if not hears or told.fit is None or told.fit < FITS:
        return False
    right = compared(corrected(cones, accused))
    # Who faces a little elsewhere hears much of it; but somewhere else more may be known.
    is_elsewhere = "east_m" in accused.evidence
    return told.fit >= FITS_AS_WELL * (right.fit or 0.0) and (
        is_elsewhere or told.gain >= right.gain
    )


def corrected(cones: Sequence[EchoCone], accused: Finding) -> list[EchoCone]:
    """A robot's pings without what may be wrong with them.

    Parameters
    ----------
    cones : sequence of EchoCone
        The pings.
    accused : Finding
        What may be wrong, of a `Displacement`.
    """

    def wrong(name: str) -> float:
        return float(accused.evidence.get(name) or 0.0)

    tracks = PoseTracks((cone, "") for cone in cones)
    off = np.array([wrong("east_m"), wrong("north_m"), wrong("turned_rad")])
    ranges = RangeError(1.0 / (1.0 + wrong("scaled")), 0.0)
    places = [tracks.later(cone, "", wrong("late_s")) - off for cone in cones]
    return [
        with_ranges(with_pose(cone, place), ranges)
        for cone, place in zip(cones, places, strict=True)
    ]
