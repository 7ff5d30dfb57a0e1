"""What a map from the first echo's range alone looks like: the model that others are held to.

nav2's costmap treats an ultrasonic sensor as one that measures a single range.  Cells in front
of it become freer, cells at it more occupied, the more so the nearer they are to the axis; see
``range_sensor_layer`` and Moravec & Elfes, "High resolution maps from wide angle sonar", 1985.
"""

import math

import numpy as np

from usmap_ros.mapping.footprint import footprint
from usmap_ros.mapping.yardsticks.cell_fusion import CellFusion
from usmap_ros.numerics.arrays import RealArray
from usmap_ros.numerics.special import logit
from usmap_ros.parameters import MappingParameters
from usmap_ros.pings.cone import EchoCone

#: Range at which the sensor is believed half as much as close up, as in nav2.
HALF_BELIEF_M = 1.2
#: A reading that shifts a cell from ignorance by less than this says nothing of it.
LEAST_NEWS = 0.005
#: No single reading makes a cell surer than this.
GREATEST_PROBABILITY = 0.98
#: Range from which on no reading is news.
FARTHEST_M = HALF_BELIEF_M + 0.5 * math.atanh(1.0 - 4.0 * LEAST_NEWS)


class RangeSensorFusion(CellFusion):
    """A map that adds up what single range readings say of each cell.

    Parameters
    ----------
    parameters : MappingParameters
        Only cell size and clamps count.
    """

    def __init__(self, parameters: MappingParameters) -> None:
        # The model knows no prior but ignorance.
        super().__init__(parameters.model_copy(update={"prior": 0.5}))

    def _take_up(self, cone: EchoCone, source: str) -> None:
        """Take up the range of a cone's first echo, or its silence."""
        cells = footprint(cone, self.parameters.resolution_m, FARTHEST_M)
        probability = occupied_probability(
            cells.range_m,
            cells.bearing_rad / cone.transducer.beam.half_angle_rad,
            float(cone.ranges_m[0]) if len(cone.ranges_m) else np.inf,
            self.parameters.resolution_m,
        )
        told = np.abs(probability - 0.5) > LEAST_NEWS
        self._add(
            cells.rows[told],
            cells.columns[told],
            logit(probability[told]),
            exposure=self.parameters.observed_exposure,
        )


def occupied_probability(
    range_m: RealArray, off_axis: RealArray, echo_m: float, depth_m: float
) -> RealArray:
    """Probability that cells are occupied, by a single range reading.

    Parameters
    ----------
    range_m : (cells,) array
        Distance of the cells.
    off_axis : (cells,) array
        Their bearing, 1 at the edge of the beam.
    echo_m : float
        The reading; infinite if nothing was heard.
    depth_m : float
        How far before and behind the reading its object may stand.
    """
    nearness = 0.5 * (1.0 - np.tanh(2.0 * (range_m - HALF_BELIEF_M)))
    belief = nearness * np.maximum(1.0 - off_axis**2, 0.0)
    # From 0 at the reading to 1 and beyond, before it and behind.
    offset = np.abs(range_m - echo_m) / depth_m if np.isfinite(echo_m) else np.full_like(belief, 9)
    free = 0.5 * (1.0 - belief)
    occupied = 0.5 + 0.5 * belief * np.maximum(1.0 - offset**2, 0.0)
    probability = np.where(offset < 1.0, occupied, np.where(range_m < echo_m, free, 0.5))
    return np.clip(probability, 1.0 - GREATEST_PROBABILITY, GREATEST_PROBABILITY)
