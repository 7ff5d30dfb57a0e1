"""Definitions of message types, as recordings carry them."""

from __future__ import annotations

from pathlib import Path

from ament_index_python.packages import PackageNotFoundError, get_package_share_directory
from rosbags.typesys import get_types_from_msg

from usmap_ros.errors import UsmapError
from usmap_ros.io.message_types import learn_standard, typestore


class UnknownTypeError(UsmapError):
    """A message type of which there is no definition."""


def definition_of(message_type: str) -> tuple[str, str]:
    """Definition of a type, with those of all types in it, and its RIHS01 hash.

    Types that are neither standard nor ours are looked up in the installed packages.

    Raises
    ------
    UnknownTypeError
        If there is no definition.
    """
    store = typestore()
    _learn(message_type)
    definition, _ = store.generate_msgdef(message_type, ros_version=2)
    return definition, store.hash_rihs01(message_type)


def _learn(message_type: str) -> None:
    """Make a type, and all types in it, known to rosbags."""
    store = typestore()
    learn_standard(message_type)
    if message_type in store.types:
        return
    package, _, name = message_type.split("/")
    try:
        path = Path(get_package_share_directory(package), "msg", f"{name}.msg")
        text = path.read_text(encoding="utf-8")
    except (PackageNotFoundError, OSError) as error:
        raise UnknownTypeError(f"there is no definition of {message_type}") from error
    learnt = get_types_from_msg(text, message_type)
    store.register(learnt)
    for _, fields in learnt.values():
        for _, (_, description) in fields:
            for part in _names_in(description):
                _learn(part)


def _names_in(description: object) -> list[str]:
    """Names of the message types in rosbags' description of a field."""
    if isinstance(description, str):
        return [description] if description.count("/") == 2 else []
    if isinstance(description, tuple):
        return [name for part in description for name in _names_in(part)]
    return []
