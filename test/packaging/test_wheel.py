"""The wheel has everything, and asks for nothing of ROS."""

import subprocess
import sys
from email.parser import Parser
from zipfile import ZipFile

import pytest
from packaging.requirements import Requirement

from usmap_ros.nodes.program import NODE_NAMES

EXECUTABLES = [*NODE_NAMES, "usmap"]


@pytest.fixture
def wheel(copy, tmp_path, clean_environment):
    """Give the wheel built from the checkout."""
    command = [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps"]
    subprocess.run(
        [*command, "--wheel-dir", str(tmp_path), str(copy)], check=True, env=clean_environment
    )
    (path,) = tmp_path.glob("*.whl")
    with ZipFile(path) as opened:
        yield opened


@pytest.mark.slow
def test_wheel_is_complete_and_needs_no_ros(wheel, root, sources):
    names = set(wheel.namelist())

    packaged = {path for path in sources if path.parts[0] == "src"} - {
        path for path in sources if path.is_symlink()
    }
    assert {str(path.relative_to("src")) for path in packaged} <= names
    for path in root.glob("msg_schemas/msg/*.msg"):
        packed = wheel.read(f"usmap_ros/io/msg/{path.name}")
        assert packed == path.read_bytes()

    data = next(name for name in names if ".data/data/" in name).partition("/data/")[0] + "/data"
    for path in sources:
        if path.parts[0] in {"config", "launch"}:
            assert f"{data}/share/usmap_ros/{path}" in names
    assert f"{data}/share/ament_index/resource_index/packages/usmap_ros" in names
    for name in EXECUTABLES:
        launcher = wheel.getinfo(f"{data}/lib/usmap_ros/{name}")
        assert launcher.external_attr >> 16 & 0o111 == 0o111, f"{name} is not executable"

    metadata_name = next(name for name in names if name.endswith(".dist-info/METADATA"))
    metadata = Parser().parsestr(wheel.read(metadata_name).decode())
    required = [Requirement(line) for line in metadata.get_all("Requires-Dist")]
    unconditional = {item.name for item in required if "extra" not in str(item.marker)}
    assert "numpy" in unconditional
    assert not {name for name in unconditional if name.startswith(("ros-", "rclpy", "usmap"))}
