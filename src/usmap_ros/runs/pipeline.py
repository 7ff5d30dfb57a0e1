"""The product in one object: echo traces in, a map out."""

import logging
from collections.abc import Sequence

import numpy as np

from usmap_ros.bounds import MAX_REACHED_CELLS
from usmap_ros.calibration.learnt import LearntReception
from usmap_ros.calibration.receiver_survey import ReceiverSurvey
from usmap_ros.errors import MalformedMessageError
from usmap_ros.grids import OccupancyMap
from usmap_ros.io.wall_files import load_walls
from usmap_ros.mapping.fusion import Fusion
from usmap_ros.mapping.joint.fusion import JointFusion
from usmap_ros.mapping.yardsticks.additive import AdditiveFusion
from usmap_ros.mapping.yardsticks.range_only import RangeSensorFusion
from usmap_ros.parameters import PipelineParameters
from usmap_ros.pings.cone import EchoCone
from usmap_ros.pings.trace import EchoTrace
from usmap_ros.reconstruction.explained import Reconstruction
from usmap_ros.reconstruction.reconstructor import reconstruct, reconstruct_sounding
from usmap_ros.reconstruction.shared_noise import SharedNoise

logger = logging.getLogger(__name__)

#: Ways of fusing, by the name that the parameter ``method`` has for them.
FUSIONS: dict[str, type[Fusion]] = {
    "joint": JointFusion,
    "additive": AdditiveFusion,
    "range_only": RangeSensorFusion,
}


class Pipeline:
    """Reconstruct traces and fuse their cones.

    Offline mapping and the live nodes both run this object, so that a bag mapped offline and
    the same bag replayed through the nodes give the same map.

    Parameters
    ----------
    parameters : PipelineParameters, optional
        Of reconstruction and mapping.

    Attributes
    ----------
    fusion : Fusion
        The map, with its frame and stamp.
    noise : SharedNoise
        What is known of the noise of transducers that state none.
    reception : LearntReception
        How traces are reconstructed, by what was learnt of their transducers.
    resumed : OccupancyMap or None
        The map that it started from, if anything was known there.

    Raises
    ------
    ConfigurationError
        If the file of known walls cannot be used.
    """

    def __init__(self, parameters: PipelineParameters | None = None) -> None:
        self.parameters = parameters or PipelineParameters()
        # A file that cannot be read is an error now, not with the first ping.
        load_walls(self.parameters.reconstruction.known_walls)
        self.fusion = FUSIONS[self.parameters.mapping.method](self.parameters.mapping)
        self.noise = SharedNoise(self.parameters.reconstruction)
        self.resumed: OccupancyMap | None = None
        self.reception = LearntReception(self.parameters.reconstruction)

    def reconstruct(self, trace: EchoTrace) -> EchoCone:
        """Return the echoes in a trace, and how loud an unheard one might have been.

        Raises
        ------
        MalformedMessageError
            If the trace cannot be reconstructed.
        """
        return reconstruct(self.noise.with_noise(trace), self.reception.of([trace])).cone

    def learn_reception(self, survey: ReceiverSurvey, topic: str) -> None:
        """Reconstruct by the pulse that a survey has learnt of a topic, if any, from now on."""
        self.reception = self.reception.with_those_of(survey, topic)

    def reconstruct_sounding(
        self, traces: Sequence[EchoTrace]
    ) -> list[EchoCone | MalformedMessageError | None]:
        """Reconstruct traces of transducers that pinged at once.

        Returns
        -------
        list of EchoCone, MalformedMessageError or None
            For each trace: its cone, why there is none, or None where all that a transducer has
            heard is in the cones of others.
        """
        with_noise = [self.noise.with_noise(trace) for trace in traces]
        return [
            found.cone if isinstance(found, Reconstruction) else found
            for found in reconstruct_sounding(with_noise, self.reception.of(with_noise))
        ]

    def fuse(self, cone: EchoCone, source: str = "") -> None:
        """Take a cone up into the map; cones are expected in the order of their stamps.

        Parameters
        ----------
        cone : EchoCone
            What was heard.
        source : str
            Who heard it: see `usmap_ros.mapping.fusion.Fusion.leave_out`.

        Raises
        ------
        MalformedMessageError
            If the cone's frame is not the map's, it reaches more cells than memory is for, or
            the map's numbers would not be finite any more: it stays out of the map then.
        """
        _check_reach(cone, self.parameters.mapping.resolution_m)
        self.fusion.fuse(cone, source)
        if cells := self.fusion.mend(cone):
            raise MalformedMessageError(
                "amplitudes",
                f"would leave numbers in {cells} cells of the map that are not finite; the ping is"
                " left out, and these cells are unknown again",
            )

    def process(self, trace: EchoTrace) -> EchoCone:
        """Reconstruct a trace and take its cone up into the map."""
        cone = self.reconstruct(trace)
        self.fuse(cone)
        return cone

    def resume(self, occupancy: OccupancyMap) -> None:
        """Start from an earlier map.

        Raises
        ------
        ValueError
            If its resolution or origin does not fit.
        """
        self.fusion.resume(occupancy)
        self.resumed = occupancy if occupancy.observed.any() else None

    def refine(self, passes: int) -> None:
        """Look at the recent cones again, `passes` times.

        Raises
        ------
        UsmapError
            If the method of mapping has no use for it.
        """
        self.fusion.refine(passes)

    def occupancy_map(self) -> OccupancyMap:
        """Return the map so far; its log-odds are finite.

        Cells that the fusion holds no finite number of are unknown again, and a warning says so:
        what is written to disk or published must never keep a map from being used.
        """
        occupancy = self.fusion.occupancy_map()
        if not np.isfinite(occupancy.log_odds).all():
            logger.warning(
                "%d cells of the map held numbers that are not finite; they are unknown again",
                self.fusion.mend(),
            )
            occupancy = self.fusion.occupancy_map()
        return occupancy


def _check_reach(cone: EchoCone, resolution_m: float) -> None:
    """Refuse a cone of so many cells that one ping would take gigabytes and minutes."""
    reach_m = cone.transducer.max_range_m
    cells = (2.0 * reach_m / resolution_m) ** 2
    if cells > MAX_REACHED_CELLS:
        raise MalformedMessageError(
            "transducer.max_range",
            f"of {reach_m:g} m reaches {cells:.2g} cells of {resolution_m:g} m, one ping may reach"
            f" {MAX_REACHED_CELLS:.2g}",
        )
