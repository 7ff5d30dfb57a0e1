"""Maps of rooms of smooth walls by sensors that hear an echo or two a ping, by pyroomacoustics.

``pip install pyroomacoustics`` and ``python benchmarks/weak_sensors.py FOLDER``.  The rooms of
`room_acoustics`, of walls that scatter little, by sensors that are noisier than its own: most of
what a ping hears is a wall that it strikes squarely, or a corner, and many pings hear nothing.
What little is heard must not let anybody out.
"""

from __future__ import annotations

from types import SimpleNamespace

import room_acoustics
from stranger_recordings import compare

#: Standard deviation of noise, over what a mirror returns from a metre; share that walls scatter.
NOISE, SCATTERING = 0.006, 0.05


def drawn(kind: str, seed: int) -> SimpleNamespace:
    """What a recording is of: with poses as they are, or off by chance, and no raw signals."""
    it = room_acoustics.drawn(kind, seed)
    it.noise, it.scattering = NOISE, SCATTERING
    it.encoding = max(it.encoding, 1)
    it.poses = "exact" if it.poses == "odometry" else it.poses
    return it


def main() -> None:
    """Record, map and score."""
    compare(
        __doc__, "weak sensors", (list(room_acoustics.ROOMS), [37, 38, 39]),
        (drawn, room_acoustics.record), ("carrier, kHz", lambda it: f"{1e-3 * it.carrier:g}"),
    )  # fmt: skip


if __name__ == "__main__":
    main()
