"""The standard messages that recordings are read with are those of ROS 2 Jazzy."""

import pytest
from rosbags.typesys import Stores, get_typestore

from usmap_ros.io.message_types import STANDARD_MESSAGES, BagMessageTypes, typestore

JAZZY = get_typestore(Stores.ROS2_JAZZY)


@pytest.mark.parametrize("name", STANDARD_MESSAGES)
def test_definitions_are_those_of_jazzy(name):
    assert typestore().fielddefs[name] == JAZZY.fielddefs[name]
    assert typestore().hash_rihs01(name) == JAZZY.hash_rihs01(name)


def test_other_standard_messages_are_learnt_when_asked_for():
    grid = BagMessageTypes().message_class("nav_msgs/msg/OccupancyGrid")
    assert grid.__name__ == "nav_msgs__msg__OccupancyGrid"
    assert typestore().fielddefs["nav_msgs/msg/OccupancyGrid"][1][0][0] == "header"
