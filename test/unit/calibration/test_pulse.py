"""The pulse as it is received, and how far it can be relied on."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from usmap_ros.calibration.pulse import measure_pulse
from usmap_ros.parameters import ReconstructionParameters
from usmap_ros.simulation import Scenario, simulate

AS_REAL = Path(__file__).parents[3] / "config/scenarios/as_real.yaml"
#: Level at which samples of that scenario rest, and samples from an echo to another beside it.
RESTING, LATER = 2048.0, 80


def test_what_stands_beside_most_echoes_is_model_error() -> None:
    scenario = Scenario.load(AS_REAL).model_copy(update={"duration_s": 6.0})
    traces = [trace for topic, trace in simulate(scenario) if topic == "/robot1/echo"]
    rng = np.random.default_rng(4)

    def beside(trace, loudness):
        """Add a copy of all that is heard, now of this sign, now of the other."""
        heard = trace.samples.astype(float) - RESTING
        copy = np.concatenate([np.zeros(LATER), heard[:-LATER]])
        samples = trace.samples + loudness * rng.choice([-1.0, 1.0]) * copy
        return replace(trace, samples=samples.astype(np.float32))

    parameters = ReconstructionParameters()
    clean = measure_pulse(traces, parameters)
    crowded = measure_pulse([beside(trace, 0.12) for trace in traces], parameters)

    assert clean.is_known
    assert crowded.is_known
    assert clean.model_error < 0.07
    # As loud as the copy, or twice that where the mean pulse has taken up one of its signs.
    assert 0.08 < crowded.model_error < 0.3
