"""Packaging of usmap_ros, for pip and colcon alike.

Everything stands here rather than in pyproject.toml because ``colcon build --symlink-install``
makes executables only of the entry points that it finds in this file.
"""

import os
import subprocess
import sys
from glob import glob
from pathlib import Path

from setuptools import Distribution, find_packages, setup
from setuptools.command.develop import develop

# setuptools has no install_data of its own; distutils comes with it, so it is imported after it.
from distutils.command.install_data import install_data  # isort: skip

NAME = "usmap_ros"

NODES = [
    "bag_recorder",
    "bag_replay",
    "cone_reconstructor",
    "echo_driver",
    "map_fusion",
    "serial_driver",
]
ENTRY_POINTS = {
    "usmap": f"{NAME}.cli:main",
    **{node: f"{NAME}.nodes.{node}:main" for node in NODES},
}

TEST = [
    "hypothesis>=6.100",
    "pytest>=7.4",
    "pytest-timeout>=2.3",
    "pytest-xdist>=3.5",
]

LINT = ["mypy>=1.13", "pre-commit>=3.7", "ruff>=0.8", "scipy-stubs", "types-PyYAML"]
DASK = ["distributed>=2024.1"]


class DistributionWithData(Distribution):
    """A distribution whose data files are installed by ``pip install --editable`` too.

    setuptools asks for ``has_data`` there, which it does not have, and leaves the files out.
    """

    def has_data(self):
        """Whether there are data files."""
        return self.has_data_files()


class InstallData(install_data):
    """Install the data files, and with pip the executables where ``ros2 run`` looks for them.

    It looks in ``lib/usmap_ros``, where colcon puts them (see setup.cfg). pip puts them into
    ``bin``, where a shell finds them; in ``lib/usmap_ros`` each gets a launcher.
    """

    def run(self):
        """Install the data files, then the launchers."""
        super().run()
        # Building a wheel, setuptools writes no executables and leaves them to pip.
        if self.get_finalized_command("install_scripts").no_ep:
            folder = Path(self.install_dir, "lib", NAME)
            folder.mkdir(parents=True, exist_ok=True)
            for name in ENTRY_POINTS:
                launcher = folder / name
                launcher.write_text(f'#!/bin/sh\nexec "${{0%/*}}/../../bin/{name}" "$@"\n')
                launcher.chmod(0o755)
                self.outfiles.append(str(launcher))
        else:
            build = Path(self.get_finalized_command("build").build_base)
            install_messages(Path(self.install_dir), build)


class Develop(develop):
    """Install the package where it is, as ``colcon build --symlink-install`` does."""

    def run(self):
        """Install it, and the messages if colcon asked: pip has no build directory."""
        super().run()
        if getattr(self, "build_directory", None):
            # colcon makes this the place that it installs to.
            install_messages(Path(sys.prefix), Path(self.build_directory))


def install_messages(prefix, build):
    """Build the messages into the same place, unless the workspace or ROS has them.

    colcon looks for no packages inside of one: of a checkout in the src folder of a workspace it
    sees usmap_ros alone, and its nodes would end at their first import. Where colcon builds
    msg_schemas itself, as it does in the root of the checkout, there is nothing left to do.
    """
    places = os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)
    others = [place for place in places if place and Path(place).resolve() != prefix.resolve()]
    if any(Path(place, "share/usmap_msgs/package.xml").is_file() for place in others):
        return
    source = Path(__file__).resolve().parent / "msg_schemas"
    build = (build / "usmap_msgs").resolve()
    commands = [
        [
            *[
                "cmake",
                "-S",
                str(source),
                "-B",
                str(build),
                f"-DCMAKE_INSTALL_PREFIX={prefix.resolve()}",
            ],
            # What it does is needed for ROS from wheels, and harmless elsewhere.
            f"-DCMAKE_PROJECT_INCLUDE={source / 'cmake/pip_environment.cmake'}",
            *["-DBUILD_TESTING=OFF", f"-DPython3_EXECUTABLE={sys.executable}"],
        ],
        ["cmake", "--build", str(build), "--target", "install"],
    ]
    for command in commands:
        if subprocess.run(command, check=False).returncode != 0:
            raise SystemExit("usmap_ros: the messages in msg_schemas cannot be built")


def tree(folder):
    """List a folder for data_files, with its subfolders; nothing if it is missing."""
    listed = {}
    for path in sorted(glob(f"{folder}/**", recursive=True)):
        if Path(path).is_file():
            listed.setdefault(f"share/{NAME}/{Path(path).parent}", []).append(path)
    return list(listed.items())


setup(
    name=NAME,
    version="0.1.0",
    description="Multi-robot occupancy mapping from in-air ultrasound, offline and on ROS 2 Jazzy",
    long_description=(Path(__file__).resolve().parent / "README.md").read_text(encoding="utf-8"),
    long_description_content_type="text/markdown",
    author="usmap_ros maintainers",
    license="Apache-2.0",
    python_requires=">=3.10",
    package_dir={"": "src"},
    packages=find_packages("src"),
    # The message definitions are read as text, so that bags can be read without any ROS package.
    # The scenarios come with the package as well as in share/: the demo runs one of them.
    package_data={NAME: ["py.typed", "io/msg/*.msg", "config/**/*"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        *tree("config"),
        *tree("launch"),
    ],
    zip_safe=False,
    install_requires=[
        "lz4>=4.3.3",
        "matplotlib>=3.7",
        "mcap>=1.1",
        # Where it has no wheels the inner loops run as Python.
        "numba>=0.58.1 ; implementation_name == 'cpython'"
        " and platform_machine in 'x86_64 AMD64 aarch64 arm64'",
        "numpy>=1.26",
        "pillow>=10",
        "pydantic>=2.5",
        "PyYAML>=6",
        "rich>=13",
        "rosbags>=0.11",
        "scipy>=1.11",
        "typer>=0.19.2",
        "zstandard>=0.22",
    ],
    extras_require={
        # Others' solvers, for benchmarks/solvers.py to compare with, and another compiler, for
        # benchmarks/ahead_of_time.py.
        "bench": ["cython>=3", "pylops>=2.3", "scikit-learn>=1.3"],
        # usmap map --scheduler
        "dask": DASK,
        # colcon runs pytest only for a package whose "test" extra names it.
        "test": TEST,
        "dev": [
            *TEST,
            *DASK,
            *LINT,
        ],
        "ros": ["ros-jazzy-common-interfaces", "ros-jazzy-rclpy[fastrtps]"],
    },
    entry_points={
        "console_scripts": [f"{name} = {target}" for name, target in ENTRY_POINTS.items()]
    },
    distclass=DistributionWithData,
    cmdclass={"develop": Develop, "install_data": InstallData},
)
