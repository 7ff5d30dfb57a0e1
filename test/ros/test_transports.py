"""By what nodes reach others on the same machine: nothing that is left behind when one is killed.

What Fast DDS shares between processes stays half written where one of them is killed in the middle,
and takes down who looks at it next (eProsima/Fast-DDS#6501, #5469).
"""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from usmap_ros.nodes.plumbing import run

ROOT = Path(__file__).parents[2]
PROFILE = "FASTRTPS_DEFAULT_PROFILES_FILE"
#: Says whether a process with a node in it shares memory.
PROGRAM = """
from pathlib import Path
import rclpy
from usmap_ros.nodes.plumbing.run import prepare_environment

prepare_environment()
rclpy.init(args=[])
node = rclpy.create_node("alone")
print("shares" if "/dev/shm/fast" in Path("/proc/self/maps").read_text() else "does not")
node.destroy_node()
rclpy.shutdown()
"""


@pytest.mark.usefixtures("domain")
@pytest.mark.skipif(sys.platform != "linux", reason="asks Linux which memory a process shares")
@pytest.mark.parametrize(
    ("profile", "asked", "answer"),
    [
        (None, None, "does not"),
        (None, "DEFAULT", "shares"),
        (ROOT / "config/dds/one_machine.xml", "DEFAULT", "does not"),
    ],
    ids=["by default", "asked for", "one machine"],
)
def test_memory_is_shared_only_if_it_is_asked_for(
    profile: Path | None, asked: str | None, answer: str
) -> None:
    chosen = {PROFILE: str(profile)} if profile else {"ROS_AUTOMATIC_DISCOVERY_RANGE": "OFF"}
    chosen |= {run.TRANSPORTS_VARIABLE: asked} if asked else {}
    others = {
        name: value
        for name, value in os.environ.items()
        if name not in (PROFILE, run.TRANSPORTS_VARIABLE)
    }
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM],
        env=others | chosen,
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout.strip() == answer
