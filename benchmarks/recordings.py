"""Simulated recordings as cones, kept on disk so that another run need not simulate again."""

from __future__ import annotations

import hashlib
from functools import cache
from pathlib import Path

import rangings
from rangings import first_echoes, range_cones, range_traces

import usmap_ros
from usmap_ros.io.bag_reader import BagReader
from usmap_ros.io.bags import write_bag
from usmap_ros.parameters import ReconstructionParameters
from usmap_ros.pings.cone import EchoCone
from usmap_ros.reconstruction.reconstructor import reconstruct
from usmap_ros.simulation import Scenario, simulate

#: Cones with the topics they came on, in the order of stamps.
Cones = list[tuple[str, EchoCone]]

#: Of the package: what a cone depends on.
MAKERS = ("acoustics", "numerics", "pings", "simulation", "reconstruction")


def cones(
    scenario: Scenario,
    parameters: ReconstructionParameters,
    cache_folder: Path | None,
    sensor: str = "sonar",
) -> Cones:
    """Cones of a scenario's pings.

    Parameters
    ----------
    scenario : Scenario
        What is simulated.
    parameters : ReconstructionParameters
        How cones come from traces.
    cache_folder : path, optional
        Where cones are kept; whatever they depend on is part of their name, the code as well.
    sensor : str
        What hears them, as in `scenes.Condition`.
    """
    if cache_folder is None:
        return _simulated(scenario, parameters, sensor)
    path = cache_folder / _name(scenario, parameters, sensor)
    if not path.exists():
        # Under another name until it is whole, since others may look for it.
        unfinished = path.with_suffix(".part")
        write_bag(unfinished, _simulated(scenario, parameters, sensor), replace=True)
        unfinished.rename(path)
    with BagReader([path]) as bag:
        return list(bag.cones())


def _simulated(scenario: Scenario, parameters: ReconstructionParameters, sensor: str) -> Cones:
    if sensor == "ranges":
        return list(range_cones(scenario))
    traces = range_traces(scenario) if sensor == "range_traces" else simulate(scenario)
    found = [(topic, reconstruct(trace, parameters).cone) for topic, trace in traces]
    return first_echoes(found, scenario) if sensor == "first_echoes" else found


def _name(scenario: Scenario, parameters: ReconstructionParameters, sensor: str) -> str:
    digest = hashlib.sha256(code(MAKERS) + world(scenario))
    digest.update(parameters.model_dump_json().encode())
    if sensor != "sonar":
        digest.update(sensor.encode() + Path(rangings.__file__).read_bytes())
    return digest.hexdigest()[:24]


def world(scenario: Scenario) -> bytes:
    """A scenario with the contents of its map."""
    content = scenario.model_dump_json().encode()
    if scenario.world.map is not None:
        path = scenario.world.map.path
        content += b"".join(
            part.read_bytes() for part in sorted(path.parent.glob(f"{path.stem}.*"))
        )
    return content


@cache
def code(packages: tuple[str, ...]) -> bytes:
    """Digest of the code of some packages of usmap_ros."""
    digest = hashlib.sha256()
    for package in packages:
        for file in sorted((Path(usmap_ros.__file__).parent / package).rglob("*.py")):
            digest.update(file.read_bytes())
    return digest.digest()
