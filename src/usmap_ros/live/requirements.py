"""What the live side needs of ROS."""

from importlib.util import find_spec

from usmap_ros.errors import UsmapError


def require_ros() -> None:
    """Make sure that ROS 2 is there.

    Raises
    ------
    UsmapError
        If not, with what to do about it.
    """
    for package in ("rclpy", "usmap_msgs"):
        if find_spec(package) is None:
            raise UsmapError(
                f"this command needs ROS 2 Jazzy, and the Python package {package} is missing;"
                " see 'Install' in the README"
            )
