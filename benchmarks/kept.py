"""Results kept on disk, so that a run that was ended goes on where it was."""

from __future__ import annotations

import hashlib
import json
from dataclasses import asdict
from pathlib import Path

import numpy as np
from methods import Method
from recordings import MAKERS, code, world

from usmap_ros.evaluation.reliability import Reliability
from usmap_ros.evaluation.scoring import Score
from usmap_ros.io.atomic import write_atomically
from usmap_ros.simulation import Scenario

#: Of the package: what a score depends on.
_MAKERS = (*MAKERS, "mapping", "evaluation", "parameters", "runs")
#: What a method made of a scene, what it took, in ms a ping, and the share of open cells that it
#: knows where one could have been heard.
Judged = tuple[Score, Reliability, float, float]


class KeptResults:
    """Scores of maps, by all that they depend on, the code as well.

    Parameters
    ----------
    folder : path, optional
        Where they are; without one, nothing is kept.
    """

    def __init__(self, folder: Path | None) -> None:
        self._folder = folder

    def get(self, scenario: Scenario, sensor: str, method: Method) -> Judged | None:
        """What was kept, if anything was."""
        if self._folder is None or not (path := self._path(scenario, sensor, method)).exists():
            return None
        content = json.loads(path.read_text(encoding="utf-8"))
        counts = {name: np.array(values) for name, values in content["reliability"].items()}
        figures = content["ms_per_ping"], content["known_audible"]
        return Score(**content["score"]), Reliability(**counts), *figures

    def put(self, scenario: Scenario, sensor: str, method: Method, judged: Judged) -> None:
        """Keep a result."""
        if self._folder is None:
            return
        self._folder.mkdir(parents=True, exist_ok=True)
        counts = {name: values.tolist() for name, values in asdict(judged[1]).items()}
        content = {
            "score": asdict(judged[0]), "reliability": counts,
            "ms_per_ping": judged[2], "known_audible": judged[3],
        }  # fmt: skip
        write_atomically(self._path(scenario, sensor, method), json.dumps(content).encode())

    def _path(self, scenario: Scenario, sensor: str, method: Method) -> Path:
        assert self._folder is not None
        digest = hashlib.sha256(code(_MAKERS) + world(scenario))
        digest.update(sensor.encode())
        for module in ("methods.py", "parts.py", "rangings.py", "audible.py"):
            digest.update((Path(__file__).parent / module).read_bytes())
        digest.update(repr((method.shown, method.merges_by_maximum, method.trusted_axes)).encode())
        digest.update(method.parameters().model_dump_json().encode())
        return self._folder / f"{digest.hexdigest()[:24]}.json"
