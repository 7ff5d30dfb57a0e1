"""What the tests of the packaging share."""

import os
import shutil
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="session")
def root() -> Path:
    """Give the folder of the checkout."""
    return ROOT


@pytest.fixture(scope="session")
def sources() -> list[Path]:
    """Give the files that belong to the project, relative to the root."""
    command = ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"]
    try:
        listed = subprocess.run(command, cwd=ROOT, check=True, capture_output=True, text=True)
    except (OSError, subprocess.CalledProcessError):
        pytest.skip("not a git checkout")
    return [Path(name) for name in sorted(listed.stdout.split("\0")) if (ROOT / name).is_file()]


@pytest.fixture
def copy(sources: list[Path], tmp_path: Path) -> Path:
    """Give a copy of the checkout in which anything may be built."""
    folder = tmp_path / "checkout"
    # Git lists a symbolic link as a file, but one to a folder is none.
    links = [path.relative_to(ROOT) for path in ROOT.glob("src/**/*") if path.is_symlink()]
    for path in {*sources, *links}:
        (folder / path).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy2(ROOT / path, folder / path, follow_symlinks=False)
    return folder


@pytest.fixture(scope="session")
def clean_environment() -> dict[str, str]:
    """Give the environment without what would lead another interpreter to this one's packages."""
    # The ROS wheels extend the first two when Python starts, and remember in the third.
    private = {"LD_LIBRARY_PATH", "AMENT_PREFIX_PATH", "_ROS_WHEELS_BOOTSTRAP_COMPLETE"}
    private |= {"CMAKE_PREFIX_PATH", "COLCON_PREFIX_PATH", "PYTHONPATH", "VIRTUAL_ENV"}
    private |= {"PYTEST_ADDOPTS", "PYTEST_CURRENT_TEST", "PYTHONDONTWRITEBYTECODE"}
    return {name: value for name, value in os.environ.items() if name not in private}
