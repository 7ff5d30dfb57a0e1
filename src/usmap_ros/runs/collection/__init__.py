"""Many recordings to one map: each to cones by itself, then areas by themselves, then their maps.

A recording becomes a file of cones, a hundredth of its size, wherever there is a worker for it.
Recordings whose pings reach the same places are then fused in the order of stamps, in one place;
others apart.  Areas are a property of the recordings, not of the workers: one process does the
same work as a cluster, and gives the same map.
"""

from usmap_ros.runs.collection.areas import AreaOptions
from usmap_ros.runs.collection.cones import find_recordings
from usmap_ros.runs.collection.run import Collected, map_collection

__all__ = ["AreaOptions", "Collected", "find_recordings", "map_collection"]
