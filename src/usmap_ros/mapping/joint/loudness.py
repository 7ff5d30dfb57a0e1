"""Amplitudes on the scale of a map's model, whatever units they came in.

Who multiplies all samples of a sensor by a number, noise included, changes nothing in the world.
No driver is calibrated to what a wall returns, and no two simulators agree on it: what a source
hears loudest tells what is loud to it.
"""

from collections import defaultdict
from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from usmap_ros.pings.amplitude_scale import loudest_log_reflectivity
from usmap_ros.pings.clutter import Kind, kind_of
from usmap_ros.pings.cone import LIMIT_AMPLITUDES, LIMIT_STEP_DB, EchoCone

#: What the loudest echo of one ping in ten is beyond, dB over that of an ideal point at 1 m, were
#: they all on the axis and 1 m away: among poles 2, in smooth rooms -7 to 0, in rough ones 10 to
#: 12.  What is between these stays as it is, for kinds of places differ by as much.
FAINTEST_DB, LOUDEST_DB, QUANTILE = -8.0, 14.0, 0.9
#: Sensors of one kind hear alike, though some robots strike no wall squarely for a while: with so
#: little between it and the middle one a source has the units of that, else its own.
ALIKE_DB = 20.0
#: Pings with echoes that are needed to say anything.
LEAST_PINGS = 10


def steps_to_scale(cones: Iterable[tuple[EchoCone, str]]) -> dict[str, int]:
    """By how many steps of `LIMIT_STEP_DB` what each source hears is too faint, where it is off.

    Parameters
    ----------
    cones : iterable of (cone, source)
        All that they heard.
    """
    loudest_db: defaultdict[str, list[float]] = defaultdict(list)
    kinds: defaultdict[Kind, set[str]] = defaultdict(set)
    for cone, source in cones:
        loudest = loudest_log_reflectivity(cone)
        if loudest is not None:
            loudest_db[source].append(20.0 / np.log(10.0) * loudest)
            kinds[kind_of(cone)].add(source)
    loud_db = {
        source: float(np.quantile(levels_db, QUANTILE))
        for source, levels_db in loudest_db.items()
        if len(levels_db) >= LEAST_PINGS
    }
    steps = {}
    for sources in kinds.values():
        # Of two the louder one: who strikes nothing squarely is faint.
        own_db = sorted(loud_db[source] for source in sources if source in loud_db)
        for source in sources & loud_db.keys():
            common_db = own_db[len(own_db) // 2]
            is_alike = abs(loud_db[source] - common_db) <= ALIKE_DB
            found_db = common_db if is_alike else loud_db[source]
            fitting_db = min(max(found_db, FAINTEST_DB), LOUDEST_DB)
            if too_faint := round((fitting_db - found_db) / LIMIT_STEP_DB):
                steps[source] = too_faint
    return steps


def raised(cone: EchoCone, steps: int) -> EchoCone:
    """A cone as if its samples had been multiplied.

    Parameters
    ----------
    cone : EchoCone
        What was heard.
    steps : int
        By how many steps of `LIMIT_STEP_DB`.
    """
    factor = np.float32(10.0 ** (steps * LIMIT_STEP_DB / 20.0))
    # What was not listened to has the greatest code, whatever the units.
    deaf = len(LIMIT_AMPLITUDES) - 1
    codes = cone.detection_limits.astype(np.int64)
    codes = np.where(codes == deaf, deaf, np.clip(codes + steps, 0, deaf - 1))
    return replace(
        cone,
        amplitudes=cone.amplitudes * factor,
        amplitude_stds=cone.amplitude_stds * factor,
        detection_limits=codes.astype(np.uint8),
    )
