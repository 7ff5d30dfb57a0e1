"""``usmap compile``: what a first run would wait for."""

from usmap_ros.cli import console


def compile_loops() -> None:
    """Compile the inner loops now, which the first map would wait for.

    They are kept beside the package, or in the user's cache, for the processor at hand.
    """
    console.compile_loops(everything=True)
