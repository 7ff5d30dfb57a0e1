"""What transducers that ping at once tell each other: the bearings of their echoes."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from usmap_ros.pings.cone import EchoCone
from usmap_ros.pings.trace import EchoTrace
from usmap_ros.reconstruction.bearings import Sighting, Viewpoint, find_bearings
from usmap_ros.reconstruction.delays import DelayReconstruction

#: A trace and the echoes in it.
Reconstructed = tuple[EchoTrace, DelayReconstruction]


def is_spent(place: int, traces: Sequence[Reconstructed]) -> bool:
    """Whether all that a trace knows is in the bearings of others.

    So it is of a transducer that only listened, where one of those that it heard has a trace too.

    Parameters
    ----------
    place : int
        Which trace is meant.
    traces : sequence of (EchoTrace, DelayReconstruction)
        Traces of one stamp and array, and what each holds.
    """
    return not _has_sent(traces[place][0]) and any(_has_sent(trace) for trace, _ in traces)


def cone_with_bearings(place: int, traces: Sequence[Reconstructed]) -> EchoCone:
    """Cone of a trace, with the bearings that all of its array tell; see `is_spent`."""
    trace, found = traces[place]
    sightings = _sightings(place, traces)
    if not sightings or not _has_sent(trace):
        return found.cone
    own = found.echoes[0]
    view = Viewpoint.of(trace.pose, trace.transducer.beam, trace.channel.object_rise_m)
    bearings_rad, stds_rad = find_bearings(own, view, sightings)
    if not np.isfinite(bearings_rad).any():
        return found.cone
    # A cone has its echoes by ascending range.
    order = np.argsort(own.ranges_m)
    return replace(
        found.cone,
        bearings_rad=bearings_rad[order].astype(np.float32),
        bearing_stds_rad=stds_rad[order].astype(np.float32),
    )


def _has_sent(trace: EchoTrace) -> bool:
    return trace.is_own(trace.sent[0])


def _sightings(place: int, traces: Sequence[Reconstructed]) -> list[Sighting]:
    """What is known of the objects that one transducer heard, beside its own echoes."""
    trace, found = traces[place]
    sightings = [
        Sighting(emission.mount, emission.transducer.beam, True, echoes)
        for emission, echoes in zip(trace.sent, found.echoes, strict=True)
        if not trace.is_own(emission)
    ]
    for number, (other, others_found) in enumerate(traces):
        if number == place:
            continue
        mounts = [one.mount for one in trace.sent if one.child_frame_id == other.child_frame_id]
        for emission, echoes in zip(other.sent, others_found.echoes, strict=True):
            if emission.child_frame_id == trace.child_frame_id:
                mount = emission.mount.inverse()
                sightings.append(Sighting(mount, other.transducer.beam, True, echoes))
            elif other.is_own(emission) and mounts:
                sightings.append(Sighting(mounts[0], other.transducer.beam, False, echoes))
    return sightings
