"""What the parameters of several nodes have in common."""

from fnmatch import fnmatchcase
from typing import Any, ClassVar

from usmap_ros.parameters.fields import ParameterGroup, quantity

#: Globs have none of these, regular expressions hardly do without.
_OF_EXPRESSIONS = frozenset("(){}|+^$\\")
_MOST_CHARACTERS = 1000


class NodeParameters(ParameterGroup):
    """What all nodes have."""

    #: Parameters, or groups of them, that cannot be changed while the node runs.
    fixed: ClassVar[frozenset[str]] = frozenset({"diagnostics_period_s"})

    diagnostics_period_s: float = quantity(
        1.0, "Time from one diagnostic message to the next.", "s", ge=0.05, le=60.0
    )


def latency_limit() -> Any:
    """Declare the limit that nodes have through which messages go."""
    return quantity(
        1.0,
        "Latency beyond which the node warns in /diagnostics, if half of the messages take longer.",
        "s",
        gt=0.0,
        le=3600.0,
    )


def topic_globs(purpose: str) -> Any:
    """Declare which topics a node has to do with; `purpose` ends the description."""
    return quantity(
        "*",
        "Globs, separated by spaces, one of which the whole name of a topic must match to be"
        f" {purpose}: * stands for anything, ? for a character, [abc] for one of some.",
    )


def check_globs(globs: str) -> str:
    """Refuse what would be more than globs; a pydantic validator.

    Raises
    ------
    ValueError
        With the reason.
    """
    odd = sorted({character for character in globs if character in _OF_EXPRESSIONS})
    if odd:
        raise ValueError(
            f"has {' '.join(odd)}: is no glob; regular expressions are not taken any more, but"
            " several globs are, with spaces between them"
        )
    if len(globs) > _MOST_CHARACTERS:
        raise ValueError(f"has {len(globs)} characters, at most {_MOST_CHARACTERS} may be")
    return globs


def is_one_of(name: str, globs: str) -> bool:
    """Whether the name of a topic matches one of some globs, in time that names bound."""
    # No topic has a dot in its name: what looks like a regular expression's .* can be nothing else.
    patterns = globs.replace(".*", "*").replace(".", "?").split()
    return any(fnmatchcase(name, pattern) for pattern in patterns)
