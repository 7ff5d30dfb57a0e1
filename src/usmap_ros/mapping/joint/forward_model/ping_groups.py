"""Groups of pings, each of which one thread works on at a time."""

from itertools import pairwise

#: Groups of pings at the most, and pings that each has at the least.
MOST_GROUPS, LEAST_PINGS = 8, 32


def groups(pings: int) -> list[slice]:
    """Groups that pings are divided into: always the same for as many pings."""
    count = max(1, min(MOST_GROUPS, pings // LEAST_PINGS))
    edges = [pings * index // count for index in range(count + 1)]
    return [slice(*pair) for pair in pairwise(edges)]
