"""What 'usmap status' shows of the nodes that run."""

import json
import subprocess
import sys
from typing import Any

import pytest
from diagnostic_msgs.msg import DiagnosticStatus, KeyValue

from usmap_ros.live.health import Level
from usmap_ros.nodes.cone_reconstructor import ConeReconstructor
from usmap_ros.nodes.map_fusion import MapFusion
from usmap_ros.nodes.plumbing.status import report_of


def usmap(*arguments: str) -> list[str]:
    return [sys.executable, "-m", "usmap_ros", *arguments]


@pytest.mark.slow
def test_every_node_has_a_line(live: Any, processes: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    options = {"diagnostics_period_s": 0.1}
    # Without a clock, the reconstructor never finds that it has been silent for long.
    reconstructor = live.add(ConeReconstructor, namespace="robot1", **options)
    monkeypatch.setattr(reconstructor.health, "clock", lambda: 0.0)
    live.add(MapFusion, autostart=False, **options)
    table = processes.run(usmap("status", "--wait", "10"), "table")
    listing = processes.run(usmap("status", "--wait", "10", "--json"), "listing")
    live.until(lambda: table.poll() is not None and listing.poll() is not None, 300.0)
    first, second = sorted(table.log.read_text().splitlines(), reverse=True)
    assert first.split()[:2] == ["WARN", "/map_fusion"]
    assert first.endswith("nothing is mapped: the node is not configured")
    assert second.startswith("OK    /robot1/cone_reconstructor")
    assert second.endswith("all is well")
    assert "0.0 Hz" in second
    content = json.loads(listing.log.read_text())
    assert content["/map_fusion"]["level"] == "WARN"
    assert content["/robot1/cone_reconstructor"]["facts"]["dropped"] == "0"


@pytest.mark.slow
@pytest.mark.usefixtures("domain")
def test_silence_is_said_in_one_line() -> None:
    done = subprocess.run(
        usmap("status", "--wait", "0.2"), capture_output=True, text=True, timeout=300, check=False
    )
    assert done.returncode == 1
    assert done.stderr == ("usmap: error: no node has said anything on /diagnostics within 0.2 s\n")


def test_levels_of_others_are_understood() -> None:
    values = [KeyValue(key="rate (Hz)", value="4.0")]
    report = report_of(DiagnosticStatus(level=b"\x01", message="slow", values=values))
    assert (report.level, report.message, report.facts) == (
        Level.WARN, "slow", {"rate (Hz)": "4.0"},
    )  # fmt: skip
    assert report_of(DiagnosticStatus(level=b"\x03")).level == Level.ERROR
