"""Maps of rooms by robots that go round and look ahead only, by pyroomacoustics.

``pip install pyroomacoustics`` and ``python benchmarks/ahead_only.py FOLDER``.  The rooms, walls
and sensors of `room_acoustics`, but each robot has one transducer, as the least do: it strikes
the walls that it drives towards, each time in the same place, and sees those beside it aslant.
"""

from __future__ import annotations

from types import SimpleNamespace

import room_acoustics
from stranger_recordings import compare


def drawn(kind: str, seed: int) -> SimpleNamespace:
    """What a recording is of."""
    it = room_acoustics.drawn(kind, seed)
    it.mounts_rad = (0.0,)
    return it


def main() -> None:
    """Record, map and score."""
    compare(
        __doc__, "ahead only", (list(room_acoustics.ROOMS), [54, 55, 56]),
        (drawn, room_acoustics.record), ("scattered", lambda it: f"{it.scattering:.2f}"),
    )  # fmt: skip


if __name__ == "__main__":
    main()
