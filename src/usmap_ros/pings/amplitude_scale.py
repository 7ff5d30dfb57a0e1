"""Whether the samples of a recording have the units that they should have.

An ideal point target at 1 m gives an echo of amplitude 1.  Samples that were left in other units,
such as a converter's counts, mean reflectivities that nothing has, and a map that is blank.
"""

import math
from collections import defaultdict, deque
from statistics import median

import numpy as np

from usmap_ros.pings.cone import EchoCone

#: Reflectivities that the loudest echo of most pings can mean at all, had it come from the axis: a
#: hard wall struck squarely at 10 m is 5, and little is left of a thin pole at the edge of a beam.
LEAST_REFLECTIVITY, GREATEST_REFLECTIVITY = 0.003, 20.0
_LEAST_LOG, _GREATEST_LOG = math.log(LEAST_REFLECTIVITY), math.log(GREATEST_REFLECTIVITY)
#: What it means most often.
_USUAL_REFLECTIVITY = 0.5
#: Pings with echoes that are needed to say anything, and how many are remembered.
_LEAST_PINGS = 5
_REMEMBERED = 200


def loudest_log_reflectivity(cone: EchoCone) -> float | None:
    """Logarithm of what the loudest echo means as a reflectivity on the axis; None without any."""
    # For every ping: of a few echoes, Python's own numbers take a third of the time.
    echoes = zip(cone.ranges_m.tolist(), cone.amplitudes.tolist(), strict=True)
    absorption = math.log(10.0) / 10.0 * cone.attenuation_db_m
    on_axis = (
        math.log(amplitude) + 2.0 * math.log(range_m) + absorption * range_m
        for range_m, amplitude in echoes
        if range_m > 0.0 and amplitude > 0.0
    )
    return max(on_axis, default=None)


class AmplitudeScale:
    """Judges the amplitudes of one transducer's cones, of the latest 200 pings with echoes."""

    def __init__(self) -> None:
        self._log_reflectivities: deque[float] = deque()
        self._plausible = 0

    def add(self, cone: EchoCone) -> None:
        """Take a cone into account."""
        loudest = loudest_log_reflectivity(cone)
        if loudest is None:
            return
        self._log_reflectivities.append(loudest)
        self._plausible += _is_plausible(loudest)
        if len(self._log_reflectivities) > _REMEMBERED:
            self._plausible -= _is_plausible(self._log_reflectivities.popleft())

    @property
    def factor(self) -> float:
        """By how much samples are too large, 1 where nothing speaks against their units."""
        count = len(self._log_reflectivities)
        # Where more than half are plausible, so is the one in the middle.
        if count < _LEAST_PINGS or 2 * self._plausible > count:
            return 1.0
        typical = median(self._log_reflectivities)
        if _is_plausible(typical):
            return 1.0
        return math.exp(typical) / _USUAL_REFLECTIVITY

    def problem(self) -> str:
        """What is wrong and what to do, in one line; empty if nothing is."""
        factor = self.factor
        if factor == 1.0:
            return ""
        comparison = "louder" if factor > 1.0 else "fainter"
        return (
            f"echoes are {abs(20.0 * np.log10(factor)):.0f} dB {comparison} than objects make them:"
            " samples must be in other units, such as a converter's counts; the parameter"
            f" reconstruction.correction.gain should be about {factor:.1g}, and usmap calibrate"
            " measures it"
        )


def _is_plausible(log_reflectivity: float) -> bool:
    return _LEAST_LOG <= log_reflectivity <= _GREATEST_LOG


class AmplitudeScales:
    """Judges the amplitudes of cones topic by topic."""

    def __init__(self) -> None:
        self._scales: defaultdict[str, AmplitudeScale] = defaultdict(AmplitudeScale)

    def add(self, topic: str, cone: EchoCone) -> None:
        """Take a cone into account."""
        self._scales[topic].add(cone)

    def problems(self) -> dict[str, str]:
        """What is wrong, by topic; topics of which nothing is are left out."""
        found = {topic: scale.problem() for topic, scale in sorted(self._scales.items())}
        return {topic: problem for topic, problem in found.items() if problem}
