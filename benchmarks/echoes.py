"""Whether a change of the code left the echoes of a thousand pings of each encoding as they were.

python benchmarks/echoes.py --save FILE        # before the change
python benchmarks/echoes.py --compare FILE     # after it

A third of the pings each is of poles in the open, of a room, and of poles above a reflecting
floor.  The same simulated pings are reconstructed, at default settings; to compare prints a line
an encoding, and ends with status 1 if echoes came or went or are farther off than `RANGE_OFF_M`
and `AMPLITUDE_OFF`.  How much their standard deviations and the detection limits have changed
stands beside that.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Mapping
from itertools import islice
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from reconstruction import RATES_HZ, SCENES, received

from usmap_ros.parameters import ReconstructionParameters
from usmap_ros.pings.cone import LIMIT_STEP_DB, EchoCone
from usmap_ros.reconstruction.reconstructor import reconstruct
from usmap_ros.simulation import Scenario, simulate

#: What is the same: ranges so near to each other, and amplitudes, relative to them.
RANGE_OFF_M, AMPLITUDE_OFF = 1e-6, 1e-5
PINGS = 1000
_ECHOES = ("ranges_m", "range_stds_m", "amplitudes", "amplitude_stds")
#: Of the cones of an encoding, one after the other, by what they are of.
Columns = Mapping[str, NDArray[np.generic]]


class Change(NamedTuple):
    """How two sets of cones of the same pings differ.

    Attributes
    ----------
    pings, echoes : int
        How many there were before.
    same_count : int
        Pings with as many echoes as before; what follows is of these.
    range_m, amplitude, std, limit_db, residual : float
        Largest differences: of ranges, of amplitudes and of the standard deviations of both
        relative to them, of detection limits, and of what is left unexplained.
    """

    pings: int
    echoes: int
    same_count: int
    range_m: float
    amplitude: float
    std: float
    limit_db: float
    residual: float

    @property
    def is_none(self) -> bool:
        """Whether the echoes are the same."""
        near = self.range_m <= RANGE_OFF_M and self.amplitude <= AMPLITUDE_OFF
        return near and self.same_count == self.pings


def main() -> None:
    """Save or compare; the status is 1 if echoes have changed."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--pings", type=int, default=PINGS, help="of each encoding")
    what = parser.add_mutually_exclusive_group(required=True)
    what.add_argument("--save", type=Path, metavar="FILE", help="keep the echoes for later")
    what.add_argument("--compare", type=Path, metavar="FILE", help="with what was kept there")
    arguments = parser.parse_args()
    kept = {} if arguments.compare is None else dict(np.load(arguments.compare))
    changes = []
    for encoding in RATES_HZ:
        now = columns(reconstructed(encoding, arguments.pings))
        if arguments.save is not None:
            kept |= {f"{encoding}_{name}": column for name, column in now.items()}
            continue
        before = {name: kept[f"{encoding}_{name}"] for name in now}
        changes.append(change(before, now))
        print(f"{encoding:8}  {line(changes[-1])}")
    if arguments.save is not None:
        np.savez_compressed(arguments.save, **kept)
    sys.exit(not all(one.is_none for one in changes))


def reconstructed(encoding: str, pings: int) -> list[EchoCone]:
    """Cones of so many pings of an encoding, of all scenes in turn."""
    parameters = ReconstructionParameters()
    shares = [len(part) for part in np.array_split(np.arange(pings), len(SCENES))]
    return [
        reconstruct(trace, parameters).cone
        for scene, share in zip(SCENES, shares, strict=True)
        for _, trace in islice(simulate(_long_enough(received(scene, encoding), share)), share)
    ]


def _long_enough(scenario: Scenario, pings: int) -> Scenario:
    """The scenario, lasting until every robot alone has sent so many pings."""
    slowest_hz = min(robot.ping_rate_hz for robot in scenario.robots)
    return scenario.model_copy(update={"duration_s": pings / slowest_hz + 1.0})


def columns(cones: list[EchoCone]) -> Columns:
    """What there is to compare of cones."""

    def joined(name: str) -> NDArray[np.generic]:
        return np.concatenate([getattr(cone, name) for cone in cones])

    return {
        "counts": np.array([len(cone.ranges_m) for cone in cones]),
        "bins": np.array([len(cone.detection_limits) for cone in cones]),
        "residuals": np.array([cone.residual for cone in cones]),
        **{name: joined(name) for name in (*_ECHOES, "detection_limits")},
    }


def change(before: Columns, now: Columns) -> Change:
    """Compare the columns of the same pings.

    Raises
    ------
    ValueError
        If they are of another number of pings, or of other ranges.
    """
    if not np.array_equal(before["bins"], now["bins"]):
        raise ValueError("what was kept is of other pings: were they as many, of these scenarios?")
    same = before["counts"] == now["counts"]
    old, new = ({name: _of(one, name, same) for name in _ECHOES} for one in (before, now))
    limits = [one["detection_limits"].astype(int) for one in (before, now)]
    return Change(
        pings=len(same),
        echoes=int(np.sum(before["counts"])),
        same_count=int(np.count_nonzero(same)),
        range_m=_largest(old["ranges_m"] - new["ranges_m"]),
        amplitude=_largest(old["amplitudes"] / new["amplitudes"] - 1.0),
        std=max(
            _largest(old[name] / new[name] - 1.0) for name in ("range_stds_m", "amplitude_stds")
        ),
        limit_db=LIMIT_STEP_DB * _largest(limits[0] - limits[1]),
        residual=_largest(before["residuals"] - now["residuals"]),
    )


def _of(cones: Columns, name: str, pings: NDArray[np.bool_]) -> NDArray[np.float64]:
    """A column of the echoes of some of the pings."""
    return cones[name][np.repeat(pings, cones["counts"])].astype(float)


def _largest(differences: NDArray[np.generic]) -> float:
    return float(np.max(np.abs(differences), initial=0.0))


def line(change: Change) -> str:
    """One line that says it all."""
    return (
        f"{change.pings} pings, {change.echoes} echoes: as many in {change.same_count} pings;"
        f" at most {change.range_m:.1e} m of range, {change.amplitude:.1e} of amplitude,"
        f" {change.std:.1e} of deviations, {change.limit_db:g} dB of limits,"
        f" {change.residual:.1e} of the residual"
    )


if __name__ == "__main__":
    main()
