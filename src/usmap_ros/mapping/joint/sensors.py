"""What pings together tell of the sensors that heard them, and what each says by that."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import NamedTuple

from usmap_ros.mapping.common_error import NO_ERROR, CommonError, common_error, without_error
from usmap_ros.mapping.joint.loudness import raised, steps_to_scale
from usmap_ros.mapping.pose_delay import PoseTracks
from usmap_ros.pings.clutter import Clutter, Kind, clutter_of, without_clutter
from usmap_ros.pings.cone import EchoCone
from usmap_ros.pings.range_cones import first_return, report_first_only


class Sensors(NamedTuple):
    """What pings together tell of the sensors that heard them."""

    #: Frames of those that report the first thing only.
    first_only: set[str]
    #: See `usmap_ros.mapping.joint.loudness.steps_to_scale`.
    steps: Mapping[str, int]
    #: See `usmap_ros.pings.clutter.clutter_of`.
    clutter: Mapping[Kind, Clutter] = MappingProxyType({})
    #: What is wrong with all pings, and where they were sent from.
    common_error: CommonError = NO_ERROR
    tracks: PoseTracks = PoseTracks(())

    def heard(self, cone: EchoCone, source: str) -> EchoCone:
        """What a ping says, by such sensors."""
        if cone.child_frame_id in self.first_only:
            return first_return(cone)
        loud = raised(cone, self.steps[source]) if source in self.steps else cone
        told = without_clutter(loud, self.clutter)
        return without_error(told, source, self.common_error, self.tracks)


def sensors_of(pings: Sequence[tuple[EchoCone, str]], correct_common_errors: bool) -> Sensors:
    """What pings tell of the sensors.

    Parameters
    ----------
    pings : sequence of (EchoCone, str)
        Pings, each with its source, in the order in which they came.
    correct_common_errors : bool
        Whether what is wrong with all of them is looked for.
    """
    first_only = report_first_only(cone for cone, _ in pings)
    sensors = Sensors(first_only, steps_to_scale(pings))
    whole = [each for each in pings if each[0].child_frame_id not in first_only]
    clutter = clutter_of(sensors.heard(*each) for each in whole)
    sensors = sensors._replace(clutter=clutter)
    if not correct_common_errors:
        return sensors
    tracks = PoseTracks(whole)
    return sensors._replace(common_error=common_error(whole, tracks), tracks=tracks)
