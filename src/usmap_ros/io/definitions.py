"""Whether a recording means by a message type what this package means by it."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import Any

from rosbags.typesys import TypesysError, get_types_from_idl, get_types_from_msg

from usmap_ros.errors import BagError
from usmap_ros.io.message_types import typestore
from usmap_ros.io.storage import RecordedTopic


def check_definition(path: Path, recorded: RecordedTopic) -> None:
    """Refuse a topic whose messages are laid out differently from ours.

    Comments and constants may differ.  A recording that carries no definitions is trusted.

    Raises
    ------
    BagError
        Naming the topic, the message type and the first difference.
    """
    if recorded.encoding != "cdr":
        raise BagError(
            path, f"topic {recorded.name} is serialized as {recorded.encoding!r}, not CDR"
        )
    if not recorded.definition:
        return
    for message_type, theirs in _parse(path, recorded).items():
        difference = _difference(theirs, message_type)
        if difference:
            raise BagError(
                path,
                f"topic {recorded.name} has another definition of {message_type}: {difference}",
            )


def _parse(path: Path, recorded: RecordedTopic) -> dict[str, Any]:
    """Fields by message type, of all types in the topic's definition."""
    try:
        return _fields(recorded.definition_format, recorded.definition, recorded.message_type)
    # Its parser fails in other ways, too, on text that is no definition at all.
    except (TypesysError, ValueError, LookupError, TypeError, RecursionError) as error:
        raise BagError(
            path, f"topic {recorded.name} has a definition that cannot be parsed"
        ) from error


@lru_cache(maxsize=64)
def _fields(definition_format: str, definition: str, message_type: str) -> dict[str, Any]:
    """Parse a definition once, however many robots have it."""
    if definition_format == "ros2idl":
        types = get_types_from_idl(definition)
    else:
        types = get_types_from_msg(definition, message_type)
    return {name: fields for name, (_, fields) in types.items()}


def _difference(theirs: list[tuple[str, Any]], message_type: str) -> str:
    """Name the first field in which a definition differs from ours; empty if none does."""
    known = typestore().fielddefs.get(message_type)
    if known is None:
        return "it is unknown here"
    ours = list(known[1])
    for (their_name, their_type), (our_name, our_type) in zip(theirs, ours, strict=False):
        if their_name != our_name:
            return f"field {their_name!r} stands where {our_name!r} is expected"
        if their_type != our_type:
            return f"field {our_name!r} has another type"
    if len(theirs) > len(ours):
        return f"field {theirs[len(ours)][0]!r} is not known here"
    if len(theirs) < len(ours):
        return f"field {ours[len(theirs)][0]!r} is missing"
    return ""
