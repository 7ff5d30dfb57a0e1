"""Pictures: what is drawn, not how it looks."""

from dataclasses import replace
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pytest
from made_pings import PULSE, TRACE, TRANSDUCER
from matplotlib.axes import Axes
from PIL import Image

from usmap_ros.acoustics.beam import BeamPattern
from usmap_ros.acoustics.propagation import Channel
from usmap_ros.grids import AMBIGUITY, NORMAL, GridGeometry, OccupancyMap, TruthMap
from usmap_ros.mapping.candidates import candidate_cells
from usmap_ros.numerics.geometry import Pose
from usmap_ros.parameters import MappingParameters, ReconstructionParameters
from usmap_ros.pings.fields_of_view import Beam
from usmap_ros.pings.robot_paths import RobotPaths
from usmap_ros.pings.trace import EchoTrace
from usmap_ros.pings.trajectory import Trajectory
from usmap_ros.plotting.animation import save_animation
from usmap_ros.plotting.cone import cone_figure
from usmap_ros.plotting.map import map_figure, robot_name
from usmap_ros.plotting.overview import overview_figure
from usmap_ros.plotting.shown import MapFrame, shown_extent
from usmap_ros.plotting.style import save_figure
from usmap_ros.reconstruction.explained import Reconstruction
from usmap_ros.reconstruction.reconstructor import reconstruct

ECHO_RANGE_M = 2.0
TRUTH = TruthMap(GridGeometry(0.05, (0.0, 0.0), (20, 20)), np.eye(20, dtype=np.bool_))


@pytest.fixture(scope="module")
def trace() -> EchoTrace:
    """Give an I/Q trace of one echo from 2 m."""
    times_s = np.arange(750) / 25e3
    noise = np.random.default_rng(0).standard_normal((2, 750)) * 0.005
    signal = 0.25 * PULSE.window(times_s - 2.0 * ECHO_RANGE_M / 343.0) + noise[0] + 1j * noise[1]
    return replace(
        TRACE,
        transducer=replace(
            TRANSDUCER, beam=BeamPattern(np.array([0.0, 0.7]), np.array([1.0, 0.0]))
        ),
        pose=Pose.planar(0.5, 0.5, 0.3),
        channel=Channel(343.0),
        start_delay_s=0.0,
        noise_std=0.007,
        samples=signal.view(np.float64).astype(np.float32),
    )


@pytest.fixture(scope="module")
def reconstruction(trace: EchoTrace) -> Reconstruction:
    return reconstruct(trace, ReconstructionParameters())


@pytest.fixture
def occupancy() -> OccupancyMap:
    log_odds = np.full((20, 30), -3.0, dtype=np.float32)
    log_odds[5, 7] = 3.0
    observed = np.ones((20, 30), dtype=np.bool_)
    observed[:, 25:] = False
    return OccupancyMap(GridGeometry(0.05, (0.0, 0.0), (20, 30)), log_odds, observed, "map")


def legend_of(axes: Axes) -> set[str]:
    return set(axes.get_legend_handles_labels()[1])


def labelled(axes: Axes) -> bool:
    return bool(axes.get_xlabel() and axes.get_ylabel())


def test_a_trace_is_drawn_with_its_reconstruction_and_residual(
    trace: EchoTrace, reconstruction: Reconstruction
) -> None:
    candidates = candidate_cells(reconstruction.cone, MappingParameters())
    upper, lower, *_ = overview_figure(reconstruction, candidates).axes
    assert legend_of(upper) == {"received", "reconstructed", "detection limit", "1 echo"}
    assert legend_of(lower) == {"residual", "receiver noise"}
    assert lower.get_xlabel() == "range (m)"
    # The reconstructed echo peaks where the object is.
    (reconstructed,) = [line for line in upper.lines if line.get_label() == "reconstructed"]
    peak = np.argmax(reconstructed.get_ydata())
    assert reconstructed.get_xdata()[peak] == pytest.approx(ECHO_RANGE_M, abs=0.01)


def test_a_cone_is_drawn_with_its_candidates(reconstruction: Reconstruction) -> None:
    cone = reconstruction.cone
    candidates = candidate_cells(cone, MappingParameters())
    axes, bar = cone_figure(cone, candidates, TRUTH).axes
    assert legend_of(axes) == {"range of an echo", "truth, within one cell", "transducer"}
    assert labelled(axes)
    assert axes.get_aspect() == 1.0
    assert bar.get_ylabel().startswith("likelihood")
    (image,) = axes.images
    drawn = np.ma.filled(image.get_array(), np.nan)
    assert np.count_nonzero(np.isfinite(drawn)) == len(candidates.likelihood) > 0


def test_candidates_lie_at_the_range_of_their_echo(reconstruction: Reconstruction) -> None:
    cone = reconstruction.cone
    candidates = candidate_cells(cone, MappingParameters())
    ranges_m = np.hypot(*(candidates.centers_m - cone.pose.position_m[:2]).T)
    np.testing.assert_allclose(ranges_m, ECHO_RANGE_M, atol=0.06)
    assert candidates.likelihood.max() == 1.0


def test_a_cone_without_echoes_can_be_drawn(reconstruction: Reconstruction) -> None:
    nothing = np.zeros(0, dtype=np.float32)
    silent = replace(
        reconstruction.cone, ranges_m=nothing, range_stds_m=nothing, amplitudes=nothing,
        amplitude_stds=nothing,
    )  # fmt: skip
    axes, _ = cone_figure(silent, candidate_cells(silent, MappingParameters())).axes
    assert axes.get_title(loc="left").endswith("0 echoes")


def test_an_overview_has_all_of_it(trace: EchoTrace, reconstruction: Reconstruction) -> None:
    candidates = candidate_cells(reconstruction.cone, MappingParameters())
    figure = overview_figure(reconstruction, candidates, TRUTH)
    assert len([axes for part in figure.subfigs for axes in part.axes]) == 4


def test_paths_as_told_are_drawn_from_where_the_corrected_ones_begin(
    occupancy: OccupancyMap,
) -> None:
    paths = RobotPaths()
    for number in range(3):
        paths.add("/robot1/echo", 1.0 + number, 2.0, Beam(0.0, 0.7, 5.0), number + 1)
    # The same way in a frame of its own, that begins elsewhere and faces +y.
    own = np.array([[5.0, 5.0 + number, 0.5 * np.pi] for number in range(3)])
    told = {"/robot1/echo": Trajectory.planar(np.arange(3), own)}
    axes, _ = map_figure(occupancy, paths, told=told).axes
    (dashed,) = [line for line in axes.lines if line.get_linestyle() == "--"]
    np.testing.assert_allclose(dashed.get_xydata(), [[1.0, 2.0], [2.0, 2.0], [3.0, 2.0]])
    assert dashed.get_label() == "as told"


def test_a_map_is_drawn_with_paths_and_truth(occupancy: OccupancyMap) -> None:
    paths = RobotPaths({"/robot1/echo": [(0.1, 0.1), (3.0, 0.2)]})
    figure = map_figure(occupancy, paths, TRUTH, title="Room")
    axes, _ = figure.axes
    explained = {text.get_text() for text in figure.legends[0].get_texts()}
    assert explained == {"free", "unknown", "truth, within one cell", "robot1"}
    assert labelled(axes)
    # The path leads out of the map, and is seen all the same.
    assert axes.get_xlim()[1] > 3.0
    drawn = axes.images[0].get_array()
    assert np.ma.getmaskarray(np.ma.masked_invalid(drawn))[:, 25:].all()


def test_normals_are_ticks_on_the_map(occupancy: OccupancyMap) -> None:
    normal_rad = np.full((20, 30), np.nan, np.float32)
    normal_rad[5, 7] = np.pi / 2.0
    figure = map_figure(replace(occupancy, layers={NORMAL: normal_rad}), layer=NORMAL)
    axes, bar = figure.axes
    (ticks,) = [line for line in axes.lines if line.get_label() == "faces"]
    np.testing.assert_allclose(ticks.get_xydata()[:2], [[0.375, 0.275], [0.375, 0.425]], atol=1e-6)
    assert bar.get_ylabel() == "probability of being occupied"


def test_ambiguity_is_drawn_where_anything_was_seen_or_suspected(occupancy: OccupancyMap) -> None:
    ambiguity = np.zeros((20, 30), np.float32)
    ambiguity[3, 28] = 0.75
    figure = map_figure(replace(occupancy, layers={AMBIGUITY: ambiguity}), layer=AMBIGUITY)
    axes, bar = figure.axes
    drawn = np.ma.filled(axes.images[0].get_array().astype(float), np.nan)
    assert drawn[3, 28] == 0.75
    assert np.count_nonzero(np.isnan(drawn[:, 25:])) == 20 * 5 - 1
    assert bar.get_ylabel() == "how undecided"
    explained = {text.get_text() for text in figure.legends[0].get_texts()}
    assert explained == {"decided", "unknown"}


def test_a_layer_that_a_map_lacks_cannot_be_drawn(occupancy: OccupancyMap) -> None:
    with pytest.raises(ValueError, match="has no layer normal_rad"):
        map_figure(occupancy, layer=NORMAL)


def test_pictures_of_different_maps_can_show_the_same(occupancy: OccupancyMap) -> None:
    other = replace(occupancy, geometry=GridGeometry(0.05, (-1.0, 0.5), (20, 30)))
    extent_m = shown_extent([occupancy, other], RobotPaths({"/echo": [(2.0, -1.0)]}), TRUTH)
    assert extent_m == pytest.approx((-1.1, 2.1, -1.1, 1.6))
    for each in (occupancy, other):
        axes, _ = map_figure(each, truth=TRUTH, extent_m=extent_m).axes
        assert (*axes.get_xlim(), *axes.get_ylim()) == pytest.approx(extent_m)


@pytest.mark.parametrize(
    ("topic", "name"),
    [("/robot1/echo", "robot1"), ("robot1/left/echo", "robot1 left"), ("/echo", "/echo")],
)
def test_a_path_is_named_by_its_robot(topic: str, name: str) -> None:
    assert robot_name(topic) == name


def test_drawing_changes_no_global_settings(occupancy: OccupancyMap) -> None:
    before = dict(mpl.rcParams)
    map_figure(occupancy)
    assert dict(mpl.rcParams) == before


@pytest.mark.parametrize("suffix", ["png", "pdf", "svg"])
def test_the_same_picture_gives_the_same_bytes(
    occupancy: OccupancyMap, tmp_path: Path, suffix: str
) -> None:
    contents = []
    for name in ("one", "two"):
        save_figure(map_figure(occupancy), tmp_path / f"{name}.{suffix}")
        contents.append((tmp_path / f"{name}.{suffix}").read_bytes())
    assert contents[0] == contents[1]


def test_an_animation_may_shrink_and_move(
    occupancy: OccupancyMap, reconstruction: Reconstruction, tmp_path: Path
) -> None:
    elsewhere = replace(occupancy, geometry=GridGeometry(0.05, (-0.5, 0.25), (20, 30)))
    small = OccupancyMap(
        GridGeometry(0.05, (0.2, 0.2), (2, 3)), np.zeros((2, 3), np.float32),
        np.ones((2, 3), dtype=np.bool_), "map",
    )  # fmt: skip
    cones = {"/echo": reconstruction.cone}
    maps = (occupancy, elsewhere, small)
    frames = [MapFrame(each, cones, {"/echo": 1}, number) for number, each in enumerate(maps)]
    save_animation(frames, RobotPaths({"/echo": [(0.5, 0.5)]}), tmp_path / "map.gif")
    with Image.open(tmp_path / "map.gif") as animation:
        assert animation.n_frames == 3


def test_an_animation_shows_every_frame(
    occupancy: OccupancyMap, reconstruction: Reconstruction, tmp_path: Path
) -> None:
    empty = replace(occupancy, observed=np.zeros_like(occupancy.observed))
    cones = {"/echo": reconstruction.cone}
    frames = [
        MapFrame(empty, cones, {"/echo": 1}, 0),
        MapFrame(occupancy, cones, {"/echo": 2}, 1_000_000_000),
    ]
    paths = RobotPaths({"/echo": [(0.5, 0.5), (0.6, 0.5)]})
    save_animation(frames, paths, tmp_path / "map.gif", TRUTH)
    with Image.open(tmp_path / "map.gif") as animation:
        assert animation.n_frames == 2
        assert animation.info["loop"] == 0
