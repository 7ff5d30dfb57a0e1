"""What a robot's echoes say of its receiver, before any map is looked at.

One that is dead hears nothing from anywhere, one that clips cuts off what others hear louder, or
hears what is near no louder than what is far, and one that reports more echoes than sound can tell
apart makes them up.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass

import numpy as np

from usmap_ros.mapping.joint.kept_pings import STEP_M, STEP_RAD
from usmap_ros.mapping.robot_check.finding import Finding
from usmap_ros.numerics.arrays import FloatArray
from usmap_ros.numerics.geometry import way_between
from usmap_ros.pings.cone import EchoCone

#: Places that are needed to tell that nothing is heard anywhere, and pings with echoes to tell how
#: loud the loudest are: of three robots, 60 pings each, 30 rooms.
LEAST_PLACES, LEAST_LOUDEST = 20, 12
#: Share of pings without echoes from which on a robot is dead, and above which the others' show
#: that there is little to be heard; healthy ones have up to 0.68 among poles.
SILENT, USUALLY_SILENT = 0.93, 0.75
#: Echoes in a ping that sound cannot tell apart, and how many times what others hear they must be.
MADE_UP, TIMES_OTHERS = 100.0, 3.0
#: Share of pings' loudest echoes that are cut off, of those who clip, and dB by which others' that
#: are not are louder: in 240 fleets 0.2 and 10 at the least, and none of healthy ones.
LEAST_CUT_OFF, HEADROOM_DB = 0.1, 6.0
#: Quantiles of pings' loudest echoes, between which healthy robots' are `LEAST_SPREAD_DB` apart and
#: this share of what their ranges make of them; and dB by which others' are louder for their
#: ranges.
UPPER, TOP = 0.6, 0.95
LEAST_SPREAD_DB, LEAST_SHARE, QUIETER_DB = 5.2, 0.4, 4.0
#: dB above the higher one from which on a single echo shows that nothing clips there: two clipped
#: ones that overlap are as much, 2.7 were seen in 30 fleets, and 9 of a healthy robot in a hall.
LOUDER_DB = 6.0
#: dB by which an echo fades with ln(range): as its square.
FADING_DB = 40.0 / math.log(10.0)


@dataclass(frozen=True)
class EchoHealth:
    """Of one robot, one ping from each place."""

    #: From which it looked.
    places: int
    #: Share of pings without an echo.
    silent: float
    #: Median number of echoes in a ping.
    echoes: float
    #: A quantile of how loud each ping's loudest echo would be as a mirror's from 1 m, dB.
    loudest_db: float | None = None
    #: A quantile of how loud it is, over another.
    spread_db: float | None = None
    #: By how much the ranges of those echoes let expect that they differ.
    faded_db: float | None = None
    #: By how much the loudest of all is above the former.
    most_db: float = 0.0
    #: Share of those echoes whose samples the receiver cut off, and how loud they are in the
    #: median; and a quantile of how loud the others are, dB.
    cut_off: float = 0.0
    cut_off_db: float | None = None
    whole_db: float | None = None


def echo_health(cones: Sequence[EchoCone]) -> EchoHealth | None:
    """What a robot hears; None if it has no pings."""
    if not cones:
        return None
    kept = _from_places(cones)
    counts = np.array([len(cone.ranges_m) for cone in kept])
    health = EchoHealth(len(kept), float(np.mean(counts == 0)), float(np.median(counts)))
    heard = [cone for cone in kept if len(cone.ranges_m)]
    if len(heard) < LEAST_LOUDEST:
        return health
    which = [int(np.argmax(cone.amplitudes)) for cone in heard]
    loud_db = 20.0 * np.log10(
        [float(cone.amplitudes[i]) for cone, i in zip(heard, which, strict=True)]
    )
    range_m = np.array([float(cone.ranges_m[i]) for cone, i in zip(heard, which, strict=True)])
    is_cut_off = np.array(
        [c.amplitude_stds[i] >= c.amplitudes[i] for c, i in zip(heard, which, strict=True)]
    )
    upper_db, top_db = np.quantile(loud_db, [UPPER, TOP])
    near_m, far_m = np.quantile(range_m[loud_db >= upper_db], [0.1, 0.9])
    return EchoHealth(
        health.places, health.silent, health.echoes,
        float(np.quantile(loud_db + 20.0 * np.log10(range_m), TOP)), float(top_db - upper_db),
        FADING_DB * math.log(far_m / near_m), float(loud_db.max() - top_db),
        float(is_cut_off.mean()), _quantile(loud_db[is_cut_off], 0.5),
        _quantile(loud_db[~is_cut_off], TOP),
    )  # fmt: skip


def odd_echoes(healths: Mapping[str, EchoHealth]) -> dict[str, Finding]:
    """Name those whose echoes cannot be, by robot, as compared with the others'."""
    found = {}
    for robot, own in healths.items():
        others = [other for name, other in healths.items() if name != robot]
        if finding := _odd(own, others):
            found[robot] = finding
    return found


def heard_louder(before: EchoHealth, own: EchoHealth) -> bool:
    """Whether a robot has heard far louder before than it does now: then nothing clips that low."""
    if before.whole_db is None or own.whole_db is None:
        return False
    return before.whole_db > own.whole_db + LOUDER_DB


def _odd(own: EchoHealth, others: Sequence[EchoHealth]) -> Finding | None:
    if not others:
        return None
    usual = float(np.median([other.echoes for other in others]))
    if own.echoes > MADE_UP and own.echoes > TIMES_OTHERS * usual:
        reason = f"its pings have {own.echoes:.0f} echoes, others' {usual:.0f}"
        return Finding("noisy", asdict(own), f"noisy: {reason}")
    usually = float(np.median([other.silent for other in others]))
    if own.places >= LEAST_PLACES and own.silent >= SILENT and usually < USUALLY_SILENT:
        silent = f"{own.silent:.0%} of its pings have no echo, {usually:.0%} of the others'"
        reason = f"from {own.places} places {silent}"
        return Finding("deaf", asdict(own), f"deaf: {reason}")
    return _cut_off(own, others) or _clipped(own, others)


def _cut_off(own: EchoHealth, others: Sequence[EchoHealth]) -> Finding | None:
    """Whether it cuts off what others hear louder."""
    if own.cut_off_db is None or own.cut_off < LEAST_CUT_OFF:
        return None
    louder_db = max((o.whole_db for o in others if o.whole_db is not None), default=own.cut_off_db)
    louder_db -= own.cut_off_db
    if louder_db < HEADROOM_DB:
        return None
    reason = (
        f"it cuts off the loudest echo of {own.cut_off:.0%} of its pings, others hear"
        f" {louder_db:.0f} dB louder"
    )
    return Finding("clipped", asdict(own) | {"louder_db": louder_db}, f"clipped: {reason}")


def _clipped(own: EchoHealth, others: Sequence[EchoHealth]) -> Finding | None:
    """Whether its loudest echoes are all as loud, however near."""
    known = [other.loudest_db for other in others if other.loudest_db is not None]
    if own.loudest_db is None or own.spread_db is None or own.faded_db is None or not known:
        return None
    quieter_db = float(np.median(known)) - own.loudest_db
    is_flat = own.spread_db < min(LEAST_SPREAD_DB, LEAST_SHARE * own.faded_db)
    if not is_flat or quieter_db < QUIETER_DB or own.most_db > LOUDER_DB:
        return None
    reason = (
        f"its loudest echoes lie within {own.spread_db:.1f} dB, though by their ranges within"
        f" {own.faded_db:.0f}, and {quieter_db:.0f} dB below the others' for their ranges"
    )
    return Finding("clipped", asdict(own) | {"quieter_db": quieter_db}, f"clipped: {reason}")


def _quantile(values: FloatArray, share: float) -> float | None:
    return float(np.quantile(values, share)) if len(values) else None


def _from_places(cones: Sequence[EchoCone]) -> list[EchoCone]:
    """One ping from each place on a robot's way."""
    kept: list[EchoCone] = []
    for cone in cones:
        if not kept or _is_elsewhere(kept[-1], cone):
            kept.append(cone)
    return kept


def _is_elsewhere(before: EchoCone, after: EchoCone) -> bool:
    way_m, turn_rad = way_between(before.pose, after.pose)
    return way_m > STEP_M or turn_rad > STEP_RAD
