"""Recordings of one's own hardware: files of other formats, made into traces and cones."""

from usmap_ros.importing.description import Recording
from usmap_ros.importing.ranges import imported_ranges
from usmap_ros.importing.sensor import Sensor
from usmap_ros.importing.traces import imported_traces
from usmap_ros.importing.units import unit_problem

__all__ = ["Recording", "Sensor", "imported_ranges", "imported_traces", "unit_problem"]
