"""Recordings as plain sequences of traces, for programs that need no more."""

from collections.abc import Iterable, Iterator
from pathlib import Path

from usmap_ros.errors import BagError
from usmap_ros.io.bag_reader import BagReader
from usmap_ros.io.bag_writer import new_bag
from usmap_ros.pings.cone import EchoCone
from usmap_ros.pings.trace import EchoTrace


def read_bag(*paths: str | Path) -> Iterator[tuple[str, EchoTrace]]:
    """Yield topic and trace of every ping of recordings, in the order of their stamps.

    Malformed messages are left out, damaged files read up to the damage, with a warning in the
    log; `BagReader` tells more of both.

    Parameters
    ----------
    paths : path-like
        rosbag2 folders, ``.mcap`` or ``.db3`` files.

    Raises
    ------
    BagError
        If a file is not a recording, or there are no traces in any of them.
    """
    with BagReader(paths) as bag:
        if not bag.trace_count:
            raise BagError(", ".join(map(str, paths)), "holds cones only, and no echo traces")
        yield from bag.traces()


def write_bag(
    path: str | Path, pings: Iterable[tuple[str, EchoTrace | EchoCone]], *, replace: bool = False
) -> int:
    """Record traces or cones into a new rosbag2 folder; returns how many there were.

    Parameters
    ----------
    path : path-like
        The folder, which appears when all is written.
    pings : iterable of (topic, EchoTrace or EchoCone)
        In the order of their stamps.
    replace : bool
        Whether a recording that is there may be replaced.

    Raises
    ------
    BagError
        If there is something at `path` already, or it cannot be written.
    """
    count = 0
    with new_bag(Path(path), replace=replace) as writer:
        for topic, ping in pings:
            if isinstance(ping, EchoTrace):
                writer.write_trace(topic, ping)
            else:
                writer.write_cone(topic, ping)
            count += 1
    return count
