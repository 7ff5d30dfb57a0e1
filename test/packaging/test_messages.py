"""The message definitions are those of bags already recorded."""

import json
import os
import sys
from importlib import resources
from pathlib import Path

import pytest
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

# A type hash stands in every bag and in every discovery message. These are never to change.
HASHES = {
    "EchoTrace": "RIHS01_9bfe7718096ca1527911dc6d0fbff11fbb782b717440d4fcafccf247a708ee07",
    "Transducer": "RIHS01_f757f67ea1047170cf95c0ac1c98187b7c51493e3c859015b7eaf0d6de912b6f",
}
# The others may change until the first release; only that all agree on them is checked.
NAMES = [*HASHES, "ArrayElement", "EchoCone", "TransducerArray"]


@pytest.fixture(scope="module")
def hashes() -> dict[str, str]:
    """Give the type hashes that follow from the definitions inside the package."""
    definitions = {}
    for path in (resources.files("usmap_ros") / "io/msg").iterdir():
        name = f"usmap_msgs/msg/{path.name.removesuffix('.msg')}"
        definitions |= get_types_from_msg(path.read_text(), name)
    store = get_typestore(Stores.ROS2_JAZZY)
    store.register(definitions)
    return {name.rpartition("/")[2]: store.hash_rihs01(name) for name in definitions}


def test_every_message_is_in_the_package(hashes, root):
    assert set(hashes) == set(NAMES)
    assert {path.stem for path in root.glob("msg_schemas/msg/*.msg")} == set(NAMES)


@pytest.mark.parametrize("name", HASHES)
def test_hashes_are_those_of_recorded_bags(hashes, name):
    assert hashes[name] == HASHES[name]


@pytest.mark.ros
@pytest.mark.parametrize("name", NAMES)
def test_compiled_messages_have_the_same_hashes(hashes, name):
    pytest.importorskip("usmap_msgs")
    # colcon says where it has installed packages; pip has but one place.
    prefixes = os.environ.get("AMENT_PREFIX_PATH", sys.prefix).split(os.pathsep)
    candidates = [Path(prefix, f"share/usmap_msgs/msg/{name}.json") for prefix in prefixes]
    described = json.loads(next(path for path in candidates if path.exists()).read_text())

    compiled = {entry["type_name"]: entry["hash_string"] for entry in described["type_hashes"]}

    assert compiled[f"usmap_msgs/msg/{name}"] == hashes[name]
