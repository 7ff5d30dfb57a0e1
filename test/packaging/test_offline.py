"""The offline half works where no ROS package is installed."""

import subprocess
import sys

IMPORT_ALL = """
import importlib, pkgutil, sys

for name in ["rclpy", "usmap_msgs", "std_msgs", "ament_index_python"]:
    sys.modules[name] = None  # makes its import fail

import usmap_ros

for module in pkgutil.walk_packages(usmap_ros.__path__, "usmap_ros."):
    if not module.name.startswith("usmap_ros.nodes") and not module.name.endswith("__main__"):
        importlib.import_module(module.name)
        print(module.name)
"""


def test_everything_but_the_nodes_imports_without_ros():
    imported = subprocess.run(
        [sys.executable, "-c", IMPORT_ALL], check=False, capture_output=True, text=True
    )

    assert imported.returncode == 0, imported.stderr
    assert "usmap_ros.io" in imported.stdout.split()
