"""What pings say of how well their robots hear, before any map is looked at."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace

import numpy as np

from usmap_ros.mapping.robot_check.finding import Finding, Verdict
from usmap_ros.numerics.arrays import quantiles
from usmap_ros.pings.cone import EchoCone
from usmap_ros.pings.range_cones import is_deaf_behind

#: Pings that are needed to tell.
LEAST_PINGS = 10
#: Detection limits beyond this difference from those of the fleet are odd.
ODD_LIMIT_DB = 10.0
#: A robot with fewer echoes than this share of the fleet's does not hear them.
FEW_ECHOES = 0.4
#: Quantile of a ping's detection limits that its noise sets: above it, its loud echoes may.
_QUIET = 0.1
#: Share of pings that are as full as the fullest, from which on noise fills them.
FULL_SHARE = 0.8


@dataclass(frozen=True)
class ReceiverHealth:
    """Of one robot."""

    #: Mean number of echoes in a ping.
    echoes: float
    #: Share of its pings with as many echoes as the fullest.
    full: float
    #: Median detection limit, dB re amplitude 1.
    limit_db: float
    #: Median amplitude of its echoes, dB; None without any.
    loudness_db: float | None
    #: Median over pings of the detection limit where it is quiet, dB re amplitude 1.
    quiet_limit_db: float


def receiver_health(cones: Sequence[EchoCone]) -> ReceiverHealth | None:
    """How a robot hears; None if it has too few pings to tell, or reports ranges only.

    A range reading states no noise and no loudness.  The limits of its cone say where its echo
    was, behind which it hears nothing: they tell a corridor from a hall, not receivers.
    """
    if len(cones) < LEAST_PINGS:
        return None
    heard = [cone for cone in cones if len(cone.ranges_m)]
    if sum(map(is_deaf_behind, heard)) > 0.5 * len(heard):
        return None
    counts = np.array([len(cone.ranges_m) for cone in cones])
    amplitudes = np.concatenate([cone.amplitudes for cone in cones]).astype(float)
    limits = np.array([quantiles(cone.limit_amplitudes(), _QUIET, 0.5) for cone in cones])
    quiet, usual = np.median(limits, axis=0)
    return ReceiverHealth(
        echoes=float(counts.mean()),
        full=float(np.mean(counts == counts.max())),
        limit_db=_decibels(usual),
        loudness_db=_decibels(float(np.median(amplitudes))) if len(amplitudes) else None,
        quiet_limit_db=_decibels(quiet),
    )


def odd_receivers(healths: Mapping[str, ReceiverHealth]) -> dict[str, Finding]:
    """Name those whose detection limits are far from the fleet's, by robot.

    A receiver with more noise than it says reports echoes without end, one whose noise is known
    hears few echoes, and where noise and echoes are louder, or fainter, alike it is the gain.
    Of two robots nobody can say whose gain is right: they contradict each other.

    Parameters
    ----------
    healths : mapping of str to ReceiverHealth
        Of all robots of which it is known.
    """
    left, found = dict(healths), dict[str, Finding]()
    while len(left) > 1:
        limit_db = _middle([own.limit_db for own in left.values()])
        # Of two the one with the higher limit comes first: most that goes wrong makes it higher.
        farthest = max(
            left, key=lambda name: (abs(left[name].limit_db - limit_db), left[name].limit_db)
        )
        own = left.pop(farthest)
        finding = _odd_limit(own, list(left.values()))
        if finding is None:
            return found
        found[farthest] = finding
        if len(healths) == 2 and finding.verdict == "loud":
            reason = finding.reason.removeprefix("loud: ")
            finding = replace(finding, verdict="contradicted", reason=f"contradicted: {reason}")
            return dict.fromkeys(healths, finding)
    return found


def _odd_limit(own: ReceiverHealth, others: Sequence[ReceiverHealth]) -> Finding | None:
    """What a detection limit far from others' comes from; None if it is not, or is harmless."""
    above_db = own.limit_db - _middle([other.limit_db for other in others])
    if abs(above_db) <= ODD_LIMIT_DB:
        return None
    judged = _cause(own, others, above_db)
    if judged is None:
        return None
    verdict, reason = judged
    evidence = asdict(own) | {"limit_over_others_db": above_db}
    return Finding(verdict, evidence, f"{verdict}: {reason}")


def _cause(
    own: ReceiverHealth, others: Sequence[ReceiverHealth], above_db: float
) -> tuple[Verdict, str] | None:
    """The verdict on a detection limit far from the others', and why."""
    usual = _middle([other.echoes for other in others])
    side = "above" if above_db > 0.0 else "below"
    limit = f"its detection limit is {abs(above_db):.0f} dB {side} the others'"
    if above_db > 0.0 and own.echoes < FEW_ECHOES * usual:
        return "deaf", f"it hears {own.echoes:.1f} echoes a ping, others {usual:.1f}, and {limit}"
    if above_db > 0.0 and own.full > FULL_SHARE and own.echoes > usual:
        count = f"{own.full:.0%} of its pings have {own.echoes:.0f} echoes, others' {usual:.0f}"
        return "noisy", f"{count}, and {limit}"
    known = [other.loudness_db for other in others if other.loudness_db is not None]
    if own.loudness_db is None or not known:
        return None
    louder_db = own.loudness_db - _middle(known)
    if louder_db * above_db < 0.0 or abs(louder_db) < 0.5 * abs(above_db):
        # Its echoes are as loud as others': it is only the noise, unless they mask most of it.
        quiet_db = own.quiet_limit_db - _middle([other.quiet_limit_db for other in others])
        return ("deaf", limit) if min(above_db, quiet_db) > ODD_LIMIT_DB else None
    doubt = "; or the only other robot's gain is wrong" if len(others) == 1 else ""
    if louder_db > 0.0:
        return "loud", f"its noise and echoes are {louder_db:.0f} dB louder than others'{doubt}"
    return "deaf", f"its noise and echoes are {-louder_db:.0f} dB fainter than others'{doubt}"


def _middle(values: Sequence[float]) -> float:
    return float(np.median(values))


def _decibels(amplitude: float) -> float:
    return float(20.0 * np.log10(max(amplitude, 1e-12)))
