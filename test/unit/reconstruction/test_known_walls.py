"""Walls that are known make columns that say what sound does beside them."""

from pathlib import Path

import numpy as np
import pytest

from usmap_ros.acoustics.images import Mirrors
from usmap_ros.errors import ConfigurationError
from usmap_ros.io.wall_files import KnownWalls, WallSegment, load_walls, save_walls
from usmap_ros.parameters import PipelineParameters, ReconstructionParameters
from usmap_ros.reconstruction.cell_dictionary import CellDictionary, CellObjects
from usmap_ros.reconstruction.reconstructor import reconstruct
from usmap_ros.runs.pipeline import Pipeline
from usmap_ros.simulation import Scenario, simulate

#: Along the corridor, out of the beam: the walls are heard only by way of what stands there.
CORNERS = [[[-1.0, 1.31], [6.0, 1.31]], [[-1.0, -1.07], [6.0, -1.07]]]
REFLECTIVITY = 0.6
POLES = [(1.625, 0.375), (2.375, -0.625), (3.125, 0.125)]
BURST = {"shape": "hann_burst", "carrier_hz": 50_000.0, "duration_s": 0.00032}
UNIT = {"shape": "square", "duration_s": 0.0006}


def corridor(pulse=BURST, *, wall_paths=True, poles=POLES, diffuse=0.0):
    encoding = "raw" if pulse is UNIT else "iq"
    return Scenario.from_mapping(
        {
            "duration_s": 0.1,
            "world": {
                "area_m": [-1.0, 6.0, -2.0, 2.0],
                "points": [{"x_m": x, "y_m": y} for x, y in poles],
                "walls": [{"corners_m": corners} for corners in CORNERS],
                "surface": {
                    "specular_reflectivity": REFLECTIVITY,
                    "diffuse_reflectivity": diffuse,
                },
                "wall_paths": wall_paths,
            },
            "medium": {"sound_speed_m_s": 343.0, "attenuation_db_m": 0.0},
            "robots": [
                {
                    "name": "robot",
                    "motion": {"kind": "random_walk", "start": [0.03, 0.07, 0.05], "speed_m_s": 0},
                    "transducers": [
                        {
                            "pulse": pulse,
                            "receiver": {
                                "encoding": encoding, "sample_rate_hz": 25e3, "noise_std": 1e-4,
                            },
                        }
                    ],
                }
            ],
        },
        "corridor.yaml",
    )  # fmt: skip


def heard(**options):
    ((_, trace),) = simulate(corridor(**options))
    return trace


@pytest.fixture
def known(tmp_path: Path) -> str:
    """Give a file of the corridor's walls."""
    segments = [
        WallSegment(start_m=tuple(start), end_m=tuple(end), reflectivity=REFLECTIVITY)
        for start, end in CORNERS
    ]
    save_walls(tmp_path / "walls.yaml", KnownWalls(walls=segments))
    return str(tmp_path / "walls.yaml")


def cells(**options):
    return ReconstructionParameters(dictionary="cells", cell_size_m=0.25, sparsity=30, **options)


def false_echoes(cone):
    """Echoes farther than a cell from the range of any pole."""
    ranges_m = np.hypot(*(np.array(POLES) - [0.03, 0.07]).T)
    return np.count_nonzero(np.abs(cone.ranges_m[:, np.newaxis] - ranges_m).min(axis=1) > 0.13)


@pytest.mark.parametrize("pulse", [BURST, UNIT], ids=["burst", "unit"])
def test_residual_and_false_objects_fall_where_walls_are_known(known, pulse):
    trace = heard(pulse=pulse)

    blind = reconstruct(trace, cells()).cone
    told = reconstruct(trace, cells(known_walls=known)).cone

    assert told.residual < 0.02
    assert blind.residual > 5.0 * told.residual
    assert (false_echoes(blind) > 2, false_echoes(told)) == (True, 0)


def test_without_paths_by_walls_they_make_no_difference_in_the_simulator():
    trace = heard(wall_paths=False)
    assert reconstruct(trace, cells()).cone.residual < 0.02


def test_paths_by_a_wall_have_the_lengths_of_their_images():
    pole = POLES[2]
    with_walls, without = heard(poles=[pole]), heard(poles=[pole], wall_paths=False)
    extra = np.abs(with_walls.signal() - without.signal())

    place = np.array([0.03, 0.07])
    image = np.array([pole[0], 2.0 * 1.31 - pole[1]])
    direct_m, by_wall_m = np.hypot(*(pole - place)), np.hypot(*(image - place))
    loudest_s = with_walls.sample_times_s()[np.argmax(extra)] - 0.5 * BURST["duration_s"]
    # There straight and back by way of the upper wall; the lower one is out of the beam.
    assert 343.0 * loudest_s == pytest.approx(direct_m + by_wall_m, abs=0.02)


def test_what_stands_between_stops_a_path_by_a_wall():
    pillar = {"x_m": 0.85, "y_m": 0.72, "radius_m": 0.3, "reflectivity": 1e-9}
    one = corridor(poles=[POLES[2]])
    content = one.model_dump()
    content["world"]["walls"] = content["world"]["walls"][:1]
    free = Scenario.from_mapping(content, "free.yaml")
    content["world"]["cylinders"] = [pillar]
    blocked = Scenario.from_mapping(content, "blocked.yaml")
    content["world"]["wall_paths"] = False
    plain = Scenario.from_mapping(content, "plain.yaml")
    (_, a), (_, b), (_, c) = (next(simulate(scenario)) for scenario in (free, blocked, plain))

    np.testing.assert_allclose(b.samples, c.samples, atol=1e-6)
    assert np.abs(a.samples - c.samples).max() > 0.01


def test_columns_are_heard_by_way_of_walls_and_through_none(known):
    objects = CellObjects(mirrors=load_walls(known))
    dictionary = CellDictionary.for_trace(heard(), 0.25, objects=objects)

    plain = CellDictionary.for_trace(heard(), 0.25)
    # Nothing is heard through a wall; what is within a cell of one may be the wall itself.
    y_m = dictionary.cells.centers_m[:, 1]
    behind = (y_m > 1.31 + 0.25) | (y_m < -1.07 - 0.25)
    np.testing.assert_array_equal(dictionary.norms == 0.0, behind)
    assert np.count_nonzero(~np.isclose(dictionary.norms, plain.norms)) > len(plain.norms) / 3


def test_walls_come_back_from_their_file(known):
    mirrors = load_walls(known)
    np.testing.assert_array_equal(mirrors.starts_m, [corners[0] for corners in CORNERS])
    np.testing.assert_array_equal(mirrors.reflectivities, REFLECTIVITY)
    assert len(load_walls("")) == len(Mirrors.none()) == 0


def test_a_file_that_is_missing_is_told_before_the_first_ping(tmp_path):
    parameters = PipelineParameters(reconstruction=cells(known_walls=str(tmp_path / "none.yaml")))
    with pytest.raises(ConfigurationError, match=r"none\.yaml: does not exist"):
        Pipeline(parameters)
