"""The YAML file that says what is in files of samples, and where they were recorded."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import numpy as np

from usmap_ros.io.yaml_files import load_yaml
from usmap_ros.parameters import ParameterGroup, quantity
from usmap_ros.simulation.models.transducers import (
    BeamModel,
    LinearBeamModel,
    MountModel,
    PulseModel,
)


class SamplesModel(ParameterGroup):
    """Files of samples."""

    path: str = quantity(
        "",
        "A .npz file; a .npy or .csv file with a row a ping; .wav files with a ping each, as"
        " pings/*.wav, in the order of their names; or one .wav file of all pings. Relative to"
        " this file. A driver needs none.",
    )
    name: str = quantity("samples", "Name of the array in a .npz file.")
    encoding: Literal["raw", "envelope", "iq"] = quantity(
        "raw", "What samples are; complex ones, or I and Q side by side in a .csv file, are iq."
    )
    sample_rate_hz: float = quantity(
        0.0, "Of samples, or of I/Q pairs; 0: as .wav files say.", "Hz", ge=0.0, le=1e8
    )
    start_delay_s: float = quantity(
        0.0, "From the start of emission to the first sample.", "s", ge=0.0, le=10.0
    )
    full_scale: float = quantity(
        0.0,
        "What samples are divided by; 1: they are amplitudes already; 0: not stated. Any number"
        " will do for counts, since `usmap calibrate` finds the gain.",
        ge=0.0,
        le=1e12,
    )
    noise_std: float = quantity(
        0.0, "RMS of the noise of amplitudes; 0: not known.", ge=0.0, le=1e9
    )


class PosesModel(ParameterGroup):
    """Where the robot was at each ping."""

    path: str = quantity(
        "",
        "A .csv file with a row a ping and a header of names from time_s, x_m, y_m, z_m, yaw_rad;"
        " empty: arrays of these names in the .npz file of the samples.",
    )
    position_std_m: float = quantity(0.0, "Error of x and of y.", "m", ge=0.0, le=100.0)
    yaw_std_rad: float = quantity(0.0, "Error of the heading.", "rad", ge=0.0, le=np.pi)
    mount: MountModel = quantity(
        MountModel(), "Where the transducer sits on the robot, if poses are not its own."
    )


class AirModel(ParameterGroup):
    """What the sound went through, as far as it is known."""

    temperature_c: float = quantity(20.0, "Of the air.", "°C", ge=-20.0, le=50.0)
    relative_humidity: float = quantity(0.5, "0 to 1.", ge=0.0, le=1.0)
    floor_height_m: float = quantity(
        0.0, "Of the transducer above a floor that reflects; 0: none.", "m", ge=0.0, le=1000.0
    )
    floor_reflectivity: float = quantity(0.0, "Of the floor.", ge=0.0, le=1.0)


class Recording(ParameterGroup):
    """Samples, poses and hardware of one transducer."""

    robot: str = quantity("robot1", "First part of the topic.", pattern=r"^[A-Za-z]\w*$")
    transducer: str = quantity("sonar", "Name of the transducer.", pattern=r"^[A-Za-z]\w*$")
    frame_id: str = quantity("map", "World frame of the poses.", min_length=1)
    samples: SamplesModel = quantity(..., "Files of samples.")
    poses: PosesModel = quantity(PosesModel(), "Where they were recorded.")
    pulse: PulseModel = quantity(..., "The burst that the driver sends.")
    beam: BeamModel = quantity(LinearBeamModel(), "Two-way gain off axis.")
    min_range_m: float = quantity(..., "Where the pulse still rings.", "m", ge=0.0, le=1000.0)
    max_range_m: float = quantity(..., "Largest range, one way.", "m", gt=0.0, le=1000.0)
    air: AirModel = quantity(AirModel(), "Air and floor.")
    units_checked: bool = quantity(
        False, "Whether values that look like other units are meant as they stand."
    )

    @classmethod
    def load(cls, path: str | Path) -> Recording:
        """Read a description.

        Raises
        ------
        ConfigurationError
            If there is no such file, or a key in it is unknown or has a value out of range.
        """
        return load_yaml(Path(path), cls)
