"""Layouts say nothing to RViz and Foxglove that these do not know.

Neither program runs here.  What they know was read in their sources: properties and plugins of
ros2/rviz (commit f7112b1a, rviz_common and rviz_default_plugins), settings of the panels 3D, Plot
and DiagnosticSummary of foxglove/studio (the last versions before its source was closed) and of
lichtblick-suite/lichtblick, which goes on from it (commit 66adecb9).  All leave out in silence what
they do not know.
"""

import json
from pathlib import Path
from typing import Any

import pytest
import yaml

ROOT = Path(__file__).parents[2]

#: Of every display, and of those that show a topic.
DISPLAY = {"Class", "Name", "Enabled", "Value"}
TOPIC = {"Topic"}
DISPLAYS = {
    "Grid": {
        "Reference Frame", "Plane Cell Count", "Normal Cell Count", "Cell Size", "Line Style",
        "Color", "Alpha", "Plane", "Offset",
    },
    "Map": TOPIC | {"Update Topic", "Alpha", "Color Scheme", "Draw Behind", "Use Timestamp"},
    "PointCloud2": TOPIC | {
        "Selectable", "Style", "Size (m)", "Size (Pixels)", "Alpha", "Decay Time",
        "Position Transformer", "Color Transformer", "Channel Name", "Use rainbow",
        "Invert Rainbow", "Min Color", "Max Color", "Autocompute Intensity Bounds", "Min Intensity",
        "Max Intensity",
    },
    "Range": TOPIC | {"Color", "Alpha", "Buffer Length"},
}  # fmt: skip
QUALITY = {
    "Value": None,
    "Depth": None,
    "History Policy": {"System Default", "Keep Last", "Keep All"},
    "Reliability Policy": {"System Default", "Reliable", "Best Effort"},
    "Durability Policy": {"System Default", "Transient Local", "Volatile"},
}
CHOICES = {
    "Color Scheme": {"map", "costmap", "raw"},
    "Style": {"Points", "Squares", "Flat Squares", "Spheres", "Boxes", "Tiles"},
    "Color Transformer": {"Intensity", "RGB8", "RGBF32", "FlatColor", "AxisColor"},
}
TOOLS = {"Interact", "MoveCamera", "Select", "FocusCamera", "Measure", "SetInitialPose", "SetGoal"}
VIEW = {"Class", "Name", "Value", "Scale", "Angle", "X", "Y", "Target Frame", "Near Clip Distance"}

PANELS = {
    "3D": {
        "cameraState", "followMode", "followTf", "scene", "layers", "topics", "transforms",
        "publish", "imageMode", "synchronize",
    },
    "Plot": {
        "foxglovePanelTitle", "lichtblickPanelTitle", "paths", "minYValue", "maxYValue",
        "showLegend", "legendDisplay", "isSynced",
        "xAxisVal", "xAxisPath", "followingViewWidth", "showXAxisLabels", "showYAxisLabels",
        "sidebarDimension", "minXValue", "maxXValue", "showPlotValuesInLegend",
    },
    "DiagnosticSummary": {
        "minLevel", "pinnedIds", "topicToRender", "hardwareIdFilter", "sortByLevel",
    },
}  # fmt: skip
NEEDED = {
    "3D": {"cameraState", "topics"},
    "Plot": {"paths", "showLegend", "isSynced", "xAxisVal"},
    "DiagnosticSummary": {"minLevel", "pinnedIds", "topicToRender", "hardwareIdFilter"},
}
CAMERA = {
    "distance", "perspective", "phi", "target", "targetOffset", "targetOrientation", "thetaOffset",
    "fovy", "near", "far", "logDepth",
}  # fmt: skip
GRID = {"visible", "colorMode", "minColor", "maxColor", "unknownColor", "invalidColor", "alpha"}
POINTS = {
    "visible", "colorMode", "colorField", "colorMap", "flatColor", "gradient", "explicitAlpha",
    "minValue", "maxValue", "pointSize", "pointShape", "decayTime",
}  # fmt: skip
GRID_MODES = {"custom", "map", "costmap", "raw"}
POINT_MODES = {"flat", "gradient", "colormap", "rgb", "rgba", "rgba-fields"}


@pytest.fixture(scope="module")
def rviz() -> dict[str, Any]:
    """Give RViz's configuration."""
    content = yaml.safe_load((ROOT / "config/rviz/usmap.rviz").read_text(encoding="utf-8"))
    assert isinstance(content, dict)
    return content


@pytest.fixture(scope="module")
def foxglove() -> dict[str, Any]:
    """Give Foxglove's layout."""
    content = json.loads((ROOT / "config/foxglove/usmap.json").read_text(encoding="utf-8"))
    assert isinstance(content, dict)
    return content


def plain(plugin: str) -> str:
    package, _, name = plugin.partition("/")
    assert package == "rviz_default_plugins"
    return name


def test_rviz_knows_every_display_and_what_is_set_of_it(rviz: dict[str, Any]) -> None:
    manager = rviz["Visualization Manager"]
    assert manager.keys() <= {"Class", "Global Options", "Displays", "Tools", "Views", "Name"}
    assert manager["Global Options"].keys() <= {"Background Color", "Fixed Frame", "Frame Rate"}
    for display in manager["Displays"]:
        known = DISPLAYS[plain(display["Class"])]
        assert display.keys() <= DISPLAY | known, display["Name"]
        for name, choices in CHOICES.items():
            assert display.get(name) in {None, *choices}
        for name in display.keys() & {"Topic", "Update Topic"}:
            assert display[name].keys() == QUALITY.keys()
            for policy, choices in QUALITY.items():
                assert choices is None or display[name][policy] in choices
    names = [display["Name"] for display in manager["Displays"]]
    assert len(set(names)) == len(names)


def test_rviz_knows_tools_panels_and_the_view(rviz: dict[str, Any]) -> None:
    manager = rviz["Visualization Manager"]
    assert {plain(tool["Class"]) for tool in manager["Tools"]} <= TOOLS
    assert {panel["Class"] for panel in rviz["Panels"]} <= {"rviz_common/Displays"}
    view = manager["Views"]["Current"]
    assert plain(view["Class"]) == "TopDownOrtho"
    assert view.keys() <= VIEW


def test_foxglove_knows_every_panel_and_what_is_set_of_it(foxglove: dict[str, Any]) -> None:
    assert foxglove.keys() <= {
        "configById", "globalVariables", "userNodes", "playbackConfig", "layout",
    }  # fmt: skip
    for panel, settings in foxglove["configById"].items():
        kind, _, identity = panel.partition("!")
        assert identity
        assert NEEDED[kind] <= settings.keys() <= PANELS[kind], panel
    for path in foxglove["configById"]["Plot!ranges"]["paths"]:
        assert path.keys() <= {
            "value", "enabled", "timestampMethod", "label", "color", "showLine", "lineSize",
        }  # fmt: skip
        assert path["timestampMethod"] in {"receiveTime", "headerStamp"}


def test_foxglove_knows_how_topics_are_to_be_drawn(foxglove: dict[str, Any]) -> None:
    scene = foxglove["configById"]["3D!map"]
    assert scene["cameraState"].keys() <= CAMERA
    assert scene["followMode"] in {"follow-pose", "follow-position", "follow-none"}
    assert {layer["layerId"] for layer in scene["layers"].values()} <= {"foxglove.Grid"}
    for topic, drawn in scene["topics"].items():
        known, modes = (POINTS, POINT_MODES) if "cells" in topic else (GRID, GRID_MODES)
        assert drawn.keys() <= known, topic
        assert drawn["colorMode"] in modes
        assert drawn.get("colorMap", "turbo") in {"turbo", "rainbow"}


def test_every_panel_of_foxglove_has_its_place(foxglove: dict[str, Any]) -> None:
    def panels(part: Any) -> list[str]:
        if isinstance(part, str):
            return [part]
        assert part.keys() == {"direction", "first", "second", "splitPercentage"}
        assert part["direction"] in {"row", "column"}
        return panels(part["first"]) + panels(part["second"])

    assert sorted(panels(foxglove["layout"])) == sorted(foxglove["configById"])
