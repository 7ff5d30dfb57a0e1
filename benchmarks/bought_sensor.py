"""Map with a sensor whose pulse nobody knows: as stated, as learnt, and beside an ideal one.

python benchmarks/bought_sensor.py [--kinds poles rough_rooms smooth_rooms] [--quality 12]
"""

from __future__ import annotations

import argparse
import logging
import tempfile
from pathlib import Path

import scenes

from usmap_ros.evaluation.scoring import score
from usmap_ros.io.bag_reader import BagReader
from usmap_ros.io.bag_writer import new_bag
from usmap_ros.parameters import PipelineParameters, PulseParameters, ReconstructionParameters
from usmap_ros.pings.robot_paths import RobotPaths
from usmap_ros.runs.offline import map_bag
from usmap_ros.runs.pipeline import Pipeline
from usmap_ros.simulation import Scenario, record
from usmap_ros.simulation.imperfections import RingDown
from usmap_ros.simulation.models.transducers import (
    OwnEchoModel,
    PulseModel,
    ReceiverModel,
    ResonanceModel,
    TransducerModel,
)
from usmap_ros.simulation.receiver import Converter

NOISE_STD = 0.004


def ideal() -> TransducerModel:
    """A short pulse, and I/Q samples without a flaw."""
    return TransducerModel(
        pulse=PulseModel(shape="hann_burst", carrier_hz=40e3, duration_s=3e-4),
        receiver=ReceiverModel(encoding="iq", sample_rate_hz=25e3, noise_std=NOISE_STD),
    )


def bought(quality: float) -> TransducerModel:
    """Two resonances that ring, a converter that clips, its own pulse and its mount in its ears."""
    resonances = [
        ResonanceModel(frequency_hz=frequency_hz, quality=quality)
        for frequency_hz in (40e3, 40.5e3)
    ]
    return TransducerModel(
        pulse=PulseModel(
            shape="tone_burst", carrier_hz=40e3, duration_s=3e-4, resonances=resonances
        ),
        receiver=ReceiverModel(
            encoding="raw",
            sample_rate_hz=200e3,
            noise_std=NOISE_STD,
            converter=Converter(bits=12, full_scale=1.0),
            ring_down=RingDown(amplitude=5.0, decay_s=2e-4),
            own_echoes=[
                OwnEchoModel(delay_s=delay_s, amplitude=amplitude)
                for delay_s, amplitude in ((2.1e-3, 0.3), (3.3e-3, 0.1))
            ],
        ),
    )


def with_sensor(scenario: Scenario, sensor: TransducerModel) -> Scenario:
    """The same scene, heard by another sensor."""
    robots = [robot.model_copy(update={"transducers": [sensor]}) for robot in scenario.robots]
    return scenario.model_copy(update={"robots": robots})


def line(scenario: Scenario, *, learn: bool) -> str:
    """Echoes a ping, F1, known and lost of the map of a scenario."""
    parameters = ReconstructionParameters(pulse=PulseParameters(learn=learn))
    pipeline = Pipeline(PipelineParameters(reconstruction=parameters))
    paths = RobotPaths()
    with tempfile.TemporaryDirectory() as folder:
        with new_bag(Path(folder) / "bag") as writer:
            record(scenario, writer, lambda: None)
        with BagReader([Path(folder) / "bag"]) as bag:
            run = map_bag(bag, pipeline, paths)
    found = score(pipeline.occupancy_map(), scenario.truth_map(), paths.views())
    return (
        f"{run.echoes / run.pings:.1f} echoes a ping, F1 {found.f1:.2f}, known {found.known:.2f},"
        f" lost {found.lost:.2f}"
    )


def main() -> None:
    """Print a table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--kinds", nargs="+", default=["poles", "rough_rooms", "smooth_rooms"])
    parser.add_argument("--quality", type=float, default=12.0)
    parser.add_argument("--seed", type=int, default=5)
    arguments = parser.parse_args()
    logging.getLogger("usmap_ros").setLevel(logging.ERROR)
    for kind in arguments.kinds:
        scene = scenes.scenario(kind, "100_pings", arguments.seed)
        rung = with_sensor(scene, bought(arguments.quality))
        print(f"{kind}, ideal: {line(with_sensor(scene, ideal()), learn=True)}", flush=True)
        print(f"{kind}, as stated: {line(rung, learn=False)}", flush=True)
        print(f"{kind}, learnt: {line(rung, learn=True)}", flush=True)


if __name__ == "__main__":
    main()
