"""A workspace of colcon builds both packages and really runs the tests.

colcon comes from pip and works on the ROS wheels, in an environment of its own: it needs an old
setuptools, and neither usmap_ros nor usmap_msgs may be there already, or they would stand in for
what colcon installs.
"""

import hashlib
import os
import shutil
import subprocess
import sys
import venv
from importlib.metadata import requires
from pathlib import Path
from xml.etree import ElementTree

import pytest
import yaml
from packaging.requirements import Requirement

from usmap_ros.nodes.program import NODE_NAMES

EXECUTABLES = [*NODE_NAMES, "usmap"]
#: Enough to see that tests run on what colcon built: all of them run without it anyway.  None needs
#: an inner loop, all of which would be compiled anew for this place.
SOME_TESTS = ["test/unit/acoustics", "test/ros/test_conversions.py::test_traces_come_back"]


def colcon_requirements(root: Path) -> list[str]:
    """List what colcon, the build of the messages, the package and its tests need."""
    # What the messages depend on is among what their build requires.
    command = [sys.executable, str(root / "tools/build_requirements.py"), str(root / "msg_schemas")]
    lines = subprocess.run(command, check=True, capture_output=True, text=True).stdout.splitlines()
    lines += [
        str(requirement).partition(";")[0]
        for requirement in map(Requirement, requires("usmap_ros") or [])
        if requirement.marker is None or requirement.marker.evaluate({"extra": "test"})
    ]
    lines += ["colcon-common-extensions", "setuptools<80"]
    if shutil.which("cmake") is None:
        lines.append("cmake")
    return sorted(set(lines))


def link_installed(source: Path, folder: Path) -> None:
    """Give an environment what another one has, but for its programs and for what is ours.

    Links are made in a second, and to install all that again takes more than a minute.
    """
    if source == Path(sys.base_prefix):
        return
    left_out = shutil.ignore_patterns(
        folder.name, "bin", "*usmap_*", "__pycache__", ".stamp*", "pyvenv.cfg", "lib64"
    )
    shutil.copytree(
        source, folder, copy_function=os.link, ignore=left_out, symlinks=True, dirs_exist_ok=True
    )


@pytest.fixture
def environment(root, clean_environment) -> dict[str, str]:
    """Give the environment in which colcon is found. It is made once and kept beside the tests'."""
    wanted = colcon_requirements(root)
    constraints = root / "constraints.txt"
    content = "\n".join([*wanted, constraints.read_text()])
    folder = Path(sys.prefix, "colcon")
    stamp = folder / f"stamp-{hashlib.sha256(content.encode()).hexdigest()[:16]}"
    if not stamp.exists():
        venv.create(folder, clear=True)
        link_installed(Path(sys.prefix), folder)
        # Without a pip of its own: Debian's Python may not have one to give.
        command = [sys.executable, "-m", "pip", "--python", str(folder / "bin/python"), "install"]
        subprocess.run(
            [*command, "-qq", "--no-compile", "--constraint", str(constraints), *wanted],
            check=True,
            env=clean_environment,
        )
        stamp.touch()
    return clean_environment | {
        "PATH": f"{folder / 'bin'}{os.pathsep}{clean_environment['PATH']}",
        "AMENT_PREFIX_PATH": str(folder),
        "CMAKE_PREFIX_PATH": str(folder),
    }


@pytest.fixture
def run(copy, environment):
    """Give a function that runs a command in a copy of the checkout and returns what it says."""

    def run(*command: str) -> str:
        process = subprocess.run(
            command,
            cwd=copy,
            env=environment,
            check=False,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        logs = sorted(copy.glob("log/latest_*/usmap_*/stdout_stderr.log"))
        said = [*(log.read_text()[-3000:] for log in logs), process.stdout]
        if process.returncode != 0:
            pytest.fail("\n".join(said), pytrace=False)
        return process.stdout

    return run


@pytest.mark.ros
@pytest.mark.slow
@pytest.mark.timeout(1500)
def test_workspace(run, copy):
    defaults = yaml.safe_load((copy / "colcon_defaults.yaml").read_text())
    wheels = f"-DCMAKE_PROJECT_INCLUDE={copy}/msg_schemas/cmake/pip_environment.cmake"

    run("colcon", "build", "--cmake-args", wheels)

    check_install(copy / "install", run)
    assert f"{copy}/install/usmap_msgs/" in module_file("usmap_msgs.msg", copy / "install", run)
    assert f"{copy}/install/usmap_ros/" in module_file("usmap_ros", copy / "install", run)

    # "colcon test" succeeds whether tests fail or not, and also where there are none.
    run("colcon", "test", "--pytest-args", *defaults["test"]["pytest-args"], *SOME_TESTS)
    run("colcon", "test-result")
    suite = ElementTree.parse(copy / "build/usmap_ros/pytest.xml").find(".//testsuite")
    assert int(suite.get("tests")) - int(suite.get("skipped")) > 10

    for folder in ["build", "install"]:
        shutil.rmtree(copy / folder / "usmap_ros")
    run("colcon", "build", "--symlink-install", "--packages-select", "usmap_ros")

    check_install(copy / "install", run)
    assert f"{copy}/build/usmap_ros/" in module_file("usmap_ros", copy / "install", run)


@pytest.mark.ros
@pytest.mark.slow
@pytest.mark.timeout(1500)
def test_a_clone_in_the_src_folder_of_a_workspace_has_its_messages(copy, environment, tmp_path):
    """colcon sees one package only there: the messages must come with it, not be left out."""
    workspace = tmp_path / "workspace"
    (workspace / "src").mkdir(parents=True)
    copy.rename(workspace / "src" / "usmap_ros")

    def said(*command: str) -> str:
        process = subprocess.run(
            command, cwd=workspace, env=environment, check=False, text=True,
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
        )  # fmt: skip
        assert process.returncode == 0, process.stdout
        return process.stdout

    assert said("colcon", "list", "--names-only").split() == ["usmap_ros"]
    said("colcon", "build", "--symlink-install")
    code = (
        "import usmap_msgs.msg as m, usmap_ros.nodes.map_fusion; print(m.EchoTrace(), m.__file__)"
    )
    printed = said("bash", "-c", f". install/setup.bash && python -c '{code}'")
    assert "sound_speed=0.0" in printed
    assert f"{workspace}/install/usmap_ros/" in printed


def check_install(install: Path, run) -> None:
    """Check that ``ros2 run`` will find every executable, and the package its definitions."""
    prefix = install / "usmap_ros"
    assert (prefix / "share/ament_index/resource_index/packages/usmap_ros").exists()
    for name in EXECUTABLES:
        assert os.access(prefix / "lib/usmap_ros" / name, os.X_OK), name
    assert Path(module_file("usmap_ros.io", install, run).strip()).with_name("msg").is_dir()
    run("bash", "-c", f". {install}/setup.bash && {prefix}/lib/usmap_ros/usmap --help")


def module_file(module: str, install: Path, run) -> str:
    """Return where a module is imported from after the set-up script was sourced."""
    code = f"import {module}; print({module}.__file__)"
    return run("bash", "-c", f". {install}/setup.bash && python -c '{code}'")
