"""Imports go one way, in no circle, and the core needs no ROS."""

import functools
import importlib.util
import re
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
SOURCE = ROOT / "src" / "usmap_ros"
#: Modules and packages from the bottom up; those that share a layer do not know each other.
LAYERS = [
    {"errors", "lazy_names"},
    {"bounds", "processes"},
    {"numerics"},
    {"acoustics", "grids", "parameters"},
    {"pings"},
    {"io"},
    {"simulation", "reconstruction", "mapping", "evaluation", "localisation"},
    {"calibration", "importing", "plotting"},
    {"runs"},
    {"live", "paper"},
    {"drivers"},
    {"nodes"},
    {"cli"},
    {"__main__"},
]
#: Rooms of `mapping.joint` from the bottom up, of which each knows only those before it.
JOINT = ["visibility", "forward_model", "surfaces", "free_space"]
HEIGHT = {name: height for height, layer in enumerate(LAYERS) for name in layer}
ROS = {
    "action_msgs", "ament_index_python", "builtin_interfaces", "diagnostic_msgs", "geometry_msgs",
    "launch", "launch_ros", "lifecycle_msgs", "map_msgs", "nav_msgs", "rcl_interfaces", "rclpy",
    "rosgraph_msgs", "rosidl_runtime_py", "sensor_msgs", "std_msgs", "std_srvs", "tf2_msgs",
    "tf2_ros", "usmap_msgs",
}  # fmt: skip
_spec = importlib.util.spec_from_file_location("map_of_code", ROOT / "tools" / "map_of_code.py")
assert _spec is not None
assert _spec.loader is not None
map_of_code = importlib.util.module_from_spec(_spec)
_spec.loader.exec_module(map_of_code)
MODULES: dict[str, Path] = map_of_code.modules_of(SOURCE)


def imported(path: Path) -> set[str]:
    """Every module that a file imports."""
    return set(map_of_code.imported(path, MODULES))


@functools.cache
def imports() -> dict[str, set[str]]:
    """What each module imports of the package, whose own page of names points everywhere."""
    return {
        name: {module for module in imported(path) if module in MODULES and module != name}
        for name, path in MODULES.items()
        if name != "usmap_ros"
    }


def part(module: str) -> str:
    """Module or package right below ``usmap_ros``."""
    return module.split(".")[1]


def test_every_part_has_a_layer() -> None:
    assert {part(name) for name in imports()} == set(HEIGHT)


@pytest.mark.parametrize("name", sorted(HEIGHT))
def test_no_import_goes_up_or_across(name: str) -> None:
    wrong = [
        f"{module} imports {other}"
        for module, others in imports().items()
        if part(module) == name
        for other in others - {"usmap_ros"}
        if part(other) != name and HEIGHT[part(other)] >= HEIGHT[name]
    ]
    assert not wrong


def test_rooms_of_the_joint_estimate_follow_each_other() -> None:
    within = "usmap_ros.mapping.joint."

    def height(module: str) -> int:
        # The modules beside the rooms stand above them.
        room = module.removeprefix(within).split(".")[0]
        return JOINT.index(room) if room in JOINT else len(JOINT)

    wrong = [
        f"{module} imports {other}"
        for module, others in imports().items()
        if module.startswith(within)
        for other in others
        if other.startswith(within) and height(other) > height(module)
    ]
    assert not wrong
    assert set(map(height, imports())) == set(range(len(JOINT) + 1))


def test_no_imports_form_a_circle() -> None:
    try:
        TopologicalSorter(imports()).prepare()
    except CycleError as error:
        pytest.fail(" → ".join(error.args[1]))


def test_the_core_imports_no_ros() -> None:
    """Nodes do, and commands that run nodes, in their functions."""
    wrong = [
        f"{name} imports {module}"
        for name, path in MODULES.items()
        if not name.startswith(("usmap_ros.nodes", "usmap_ros.cli"))
        for module in imported(path)
        if module.split(".")[0] in ROS
    ]
    assert not wrong


def test_the_map_of_the_code_has_the_same_layers() -> None:
    page = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    table = page.split("## The map of the code")[1].split("\n## ")[0]
    rows = re.findall(r"^\| (`[^|]*`) \|", table, flags=re.MULTILINE)
    assert [set(re.findall(r"`(\w+)`", row)) for row in rows] == LAYERS


@pytest.mark.parametrize("page", ["README.md", "src/usmap_ros/__init__.py"])
def test_what_is_said_of_the_direction_is_so(page: str) -> None:
    text = (ROOT / page).read_text(encoding="utf-8")
    (chain,) = re.findall(r"\w+`*(?: → `*\w+`*){4,}", text)
    heights = [HEIGHT[name] for name in re.findall(r"\w+", chain)]
    assert heights == sorted(set(heights))


def test_types_of_arrays_have_one_home() -> None:
    wrong = [
        name
        for name, path in MODULES.items()
        if name != "usmap_ros.numerics.arrays"
        and re.search(r"^\w+Array = ", path.read_text(encoding="utf-8"), flags=re.MULTILINE)
    ]
    assert not wrong


def test_the_tests_see_imports() -> None:
    """Or the others would pass whatever there is."""
    assert "usmap_ros.numerics.geometry" in imports()["usmap_ros.pings.trace"]
    assert "usmap_ros.evaluation.scoring" in imports()["usmap_ros.cli.evaluate"]
    assert "rclpy" in {
        module.split(".")[0]
        for name, path in MODULES.items()
        if name.startswith("usmap_ros.nodes")
        for module in imported(path)
    }
