"""The benchmark of scores: its scenes, its methods, and its table."""

import importlib
import json
import sys
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from usmap_ros.grids import GridGeometry, OccupancyMap

FOLDER = Path(__file__).parents[2] / "benchmarks"


@pytest.fixture(scope="module")
def benchmark() -> ModuleType:
    sys.path.insert(0, str(FOLDER))
    yield importlib.import_module("scores")
    sys.path.remove(str(FOLDER))


@pytest.fixture
def scenes(benchmark: ModuleType) -> ModuleType:
    return importlib.import_module("scenes")


@pytest.fixture
def methods(benchmark: ModuleType) -> ModuleType:
    return importlib.import_module("methods")


def test_every_kind_of_scene_has_room_for_its_robots(scenes: ModuleType) -> None:
    for kind in scenes.KINDS | scenes.UNSCORED:
        for seed in range(3):
            scenario = scenes.scenario(kind, "six_robots", seed)
            assert len(scenario.fleet(scenario.scene())) == 6, (kind, seed)


def test_a_seed_gives_the_same_scene_whatever_the_condition(scenes: ModuleType) -> None:
    first, again = (scenes.scenario("clutter", "plain", 4) for _ in range(2))
    assert first.model_dump() == again.model_dump()
    assert first.world != scenes.scenario("clutter", "plain", 5).world
    assert first.world == scenes.scenario("clutter", "noisy", 4).world
    assert first.world != scenes.scenario("corners", "plain", 4).world


def test_a_condition_changes_what_it_says(scenes: ModuleType) -> None:
    few = scenes.scenario("corners", "few_pings", 1)
    assert few.ping_count == 3 * 30
    off = scenes.scenario("corners", "poses_off", 1)
    assert {robot.pose_error.position_std_m for robot in off.robots} == {0.03}
    noisy = scenes.scenario("corners", "noisy", 1)
    assert noisy.robots[0].transducers[0].receiver.noise_std == 0.04


def test_every_target_speaks_of_scenes_that_there_are(
    benchmark: ModuleType, scenes: ModuleType
) -> None:
    todo = benchmark.target_cases([1, 2])
    assert len(todo) == len({(case.row, case.seed) for case in todo})
    for case in todo:
        assert case.scene in scenes.KINDS
        assert case.condition in scenes.CONDITIONS
    assert not set(benchmark.CHOOSING_SEEDS) & set(benchmark.REPORTED_SEEDS)


def test_a_missed_target_stands_out(benchmark: ModuleType) -> None:
    tables = importlib.import_module("score_tables")
    figures = {name: 0.0 for _, name, _ in tables.COLUMNS} | {"ms_per_ping": 2.0}
    rows = [
        {"scene": scene, "condition": "plain", "method": "ours", **figures, "f1": f1, "known": 1.0}
        for scene, f1 in (("columns_rough", 0.9), ("columns_smooth", 0.8), ("depot", 0.5))
    ]
    _, _, round_columns, depot = tables.targets_table(rows).splitlines()
    assert round_columns.startswith("| round columns, half smooth | ours | 0.85 (≥ 0.82) | 0.00 |")
    assert depot.startswith(
        "| depot | ours | **0.50 (≥ 0.86)** | 0.00 | 1.00 (≥ 0.7) | 0.00 | 0.000 (≤"
    )


@pytest.mark.usefixtures("benchmark")
def test_other_methods_are_compared_with_ours() -> None:
    tables = importlib.import_module("score_tables")
    rows = [
        {"scene": "depot", "condition": "plain", "method": method, "f1": f1, "known": 0.5}
        for method, f1 in (("ours", 0.9), ("live", 0.85))
    ]
    _, _, depot = tables.compared_table(rows).splitlines()
    assert depot == "| depot | 0.900 | 0.500 | -0.050 | +0.000 |"


def test_robots_stand_before_they_drive_the_same_way(scenes: ModuleType) -> None:
    parked, driving = (scenes.scenario("poles", name, 3) for name in ("100_parked", "100_pings"))
    assert (parked.ping_count, driving.ping_count) == (1200, 300)
    (one, *_), (same, *_) = (world.fleet(world.scene()) for world in (parked, driving))
    np.testing.assert_array_equal(
        one.motion.pose(36.0).position_m, same.motion.pose(6.0).position_m
    )
    assert not np.array_equal(one.motion.pose(36.0).position_m, one.motion.pose(29.0).position_m)


def test_range_sensors_read_the_nearest_surface_in_their_beams(
    scenes: ModuleType, monkeypatch: pytest.MonkeyPatch
) -> None:
    rangings = importlib.import_module("rangings")
    monkeypatch.setattr(rangings, "MISSED", 0.0)
    content = {
        "duration_s": 0.2,
        "world": {
            "walls": [{"corners_m": [[0, 0], [4, 0], [4, 4], [0, 4]], "closed": True}],
            "cylinders": [{"x_m": 2.0, "y_m": 3.0, "radius_m": 0.5}],
        },
        "robots": [
            {
                "name": "one",
                "motion": {"kind": "waypoints", "waypoints_m": [[2.0, 1.0]], "speed_m_s": 0.0},
                "transducers": scenes.transducers(scenes.CONDITIONS["ranges"]),
            }
        ],
    }
    world = scenes.Scenario.from_mapping(content, "square")
    found = list(rangings.readings(world))
    assert [reading.frame_id[-1] for _, _, _, reading in found] == list("12341234")
    ranges_m = [reading.range_m for _, _, _, reading in found]
    np.testing.assert_allclose(ranges_m, [2.0, 1.5, 2.0, 1.0] * 2, atol=0.1)
    cones = [cone for _, cone in rangings.range_cones(world)]
    np.testing.assert_allclose([cone.ranges_m[0] for cone in cones], ranges_m, rtol=1e-6)
    parameters = importlib.import_module("methods").METHODS["ours"].parameters().reconstruction
    recordings = importlib.import_module("recordings")
    heard = recordings.cones(world, parameters, None, "range_traces")
    np.testing.assert_allclose([cone.ranges_m[0] for _, cone in heard], ranges_m, atol=0.02)
    assert {len(cone.ranges_m) for _, cone in heard} == {1}


def test_poles_that_are_too_faint_are_not_asked(scenes: ModuleType, methods: ModuleType) -> None:
    recordings, audible = (importlib.import_module(name) for name in ("recordings", "audible"))
    content = {
        "duration_s": 0.3,
        "world": {
            "area_m": [-1, 6, -3, 3],
            "points": [
                {"x_m": 1.02, "y_m": 0.02},
                {"x_m": 1.52, "y_m": 0.52, "reflectivity": 0.01},  # Too small.
                {"x_m": 0.72, "y_m": 0.57},  # At the edge of the beam.
                {"x_m": -0.48, "y_m": 0.02},  # Behind.
                {"x_m": 2.02, "y_m": -0.48},
            ],
        },
        "robots": [{"name": "one", "motion": {"kind": "waypoints", "waypoints_m": [[0, 0]]}}],
    }
    world = scenes.Scenario.from_mapping(content, "poles")
    recorded = recordings.cones(world, methods.METHODS["ours"].parameters().reconstruction, None)
    truth = world.truth_map()
    left = audible.audible_poles(world, recorded, truth)
    assert truth.occupied.sum() == 5
    rows, columns = np.nonzero(left.occupied)
    places = truth.geometry.cell_centers_m(rows, columns)
    np.testing.assert_allclose(sorted(places.tolist()), [[1.025, 0.025], [2.025, -0.475]])
    once = audible.audible_poles(world, recorded[:1], truth)
    assert not once.occupied.any()
    shape = truth.geometry.shape
    x_m = truth.geometry.cell_centers_m(*np.indices(shape).reshape(2, -1))[:, 0].reshape(shape)

    def known_up_to(farthest_m: float, pings: int = 3) -> float:
        free = OccupancyMap(truth.geometry, np.full(shape, -3.0, np.float32), x_m < farthest_m, "")
        return float(audible.known_where_audible(world, recorded[:pings], free, truth))

    # Sound goes from the origin eastwards, and is too faint before the truth ends.
    assert (known_up_to(-0.1), known_up_to(4.9), known_up_to(9.0)) == (0.0, 1.0, 1.0)
    assert 0.0 < known_up_to(1.0) < known_up_to(2.0) < 1.0
    assert known_up_to(9.0, pings=1) == 0.0


def test_every_method_has_parameters_that_exist(methods: ModuleType) -> None:
    for method in methods.METHODS.values():
        method.parameters()


def test_a_live_map_is_of_all_pings_and_not_the_whole_one(
    methods: ModuleType, scenes: ModuleType
) -> None:
    recordings = importlib.import_module("recordings")
    world = scenes.scenario("poles", "few_pings", 901)
    cones = recordings.cones(world, methods.METHODS["ours"].parameters().reconstruction, None)
    whole, live = (methods.METHODS[name].map(cones) for name in ("ours", "live"))
    assert live.stamp_ns == whole.stamp_ns
    assert live.predicted().any()
    assert not np.array_equal(live.log_odds, whole.log_odds)


def test_parts_are_left_out_for_the_time_of_a_map_alone(methods: ModuleType) -> None:
    parts = importlib.import_module("parts")
    for part in parts.PARTS.values():
        before = [getattr(owner, name) for owner, name, _ in part.instead]
        with parts.left_out(part.instead):
            assert all(getattr(owner, name) is other for owner, name, other in part.instead)
        assert [getattr(owner, name) for owner, name, _ in part.instead] == before
        assert part.instead or part.settings
    assert methods.ABLATIONS.keys() <= methods.METHODS.keys()


@pytest.mark.usefixtures("benchmark")
def test_parts_are_worth_means_of_what_is_found_and_the_worst_of_what_is_freed(
    tmp_path: Path,
) -> None:
    ablations = importlib.import_module("ablations")
    rows = [
        {"method": method, "f1": f1, "known": 0.5, "leak": leak, "lost": 0.01, "escape_m2": 0.0}
        for method, f1, leak in [
            ("ours", 0.9, 0.0), ("ours", 0.7, 0.01), ("no_room", 0.6, 0.03), ("no_room", 0.8, 0.0),
        ]
    ]  # fmt: skip
    found = ablations.worth(rows)
    assert found["ours"] == pytest.approx(
        {"f1": 0.8, "known": 0.5, "leak": 0.01, "lost": 0.01, "escape_m2": 0.0}
    )
    lines = ablations.markdown(found).splitlines()
    assert (
        lines[-1]
        == "| walls need no room | 0.700 | -0.100 | 0.500 | +0.000 | 0.030 | 0.010 | 0.00 |"
    )
    ablations.draw(found, tmp_path / "ablations.png")
    assert (tmp_path / "ablations.png").stat().st_size > 1000


def test_maps_are_merged_by_the_larger_probability_of_those_observed(methods: ModuleType) -> None:
    def single(left_m: float, log_odds: list[float], observed: list[bool]) -> OccupancyMap:
        geometry = GridGeometry(0.5, (left_m, 0.0), (1, len(log_odds)))
        return OccupancyMap(geometry, np.float32([log_odds]), np.array([observed]), "map")

    merged = methods._max_merged(
        [single(-0.5, [1.0, -2.0, 3.0], [True, True, True]),
         single(0.0, [-1.0, 5.0, 4.0], [True, False, True])]
    )  # fmt: skip
    assert merged.geometry == GridGeometry(0.5, (-0.5, 0.0), (1, 4))
    assert merged.observed.all()
    assert merged.log_odds.tolist() == [[1.0, -1.0, 3.0, 4.0]]


@pytest.fixture(scope="module")
def tiny(benchmark: ModuleType) -> None:
    """A condition that is quickly simulated."""
    conditions = benchmark.CONDITIONS
    conditions["tiny"] = type(conditions["plain"])("four pings", robots=2, pings=4)
    yield
    del conditions["tiny"]


@pytest.mark.usefixtures("tiny")
def test_table_and_pictures_of_a_small_run(benchmark: ModuleType, tmp_path: Path) -> None:
    todo = benchmark.cases(["corners"], ["tiny"], [1, 2])
    chosen = ["ours", "range_only", "max_merging"]
    (tmp_path / "maps").mkdir()
    results = benchmark.all_results(todo, chosen, tmp_path / "cones", tmp_path / "maps")
    rows = benchmark.summary(results)
    json.dumps(rows)
    assert [row["method"] for row in rows] == chosen
    assert all(row["seeds"] == [1, 2] for row in rows)
    ours = [result.score.f1 for result in results if result.method == "ours"]
    assert rows[0]["f1"] == pytest.approx(np.mean(ours))
    assert rows[0]["f1_std"] == pytest.approx(np.std(ours))
    lines = benchmark.markdown(rows).splitlines()
    assert lines[2].startswith("| corners, four pings | ours | ")
    assert len(lines) == 2 + len(chosen)
    benchmark.draw_scores(rows, tmp_path / "scores.png")
    assert [path.name for path in (tmp_path / "maps").iterdir()] == ["corners_tiny_1.png"]

    # From what was kept, the same scores; without the scores, from the cones.
    kept = sorted((tmp_path / "cones").iterdir())
    assert [path.name for path in kept if not path.suffix][-1] == "scores"
    assert len(kept) == 3
    again = benchmark.all_results(todo, chosen, tmp_path / "cones", tmp_path / "maps")
    # Where too little is predicted, how reliable it is is no number.
    np.testing.assert_equal(benchmark.summary(again), rows)
    for path in (tmp_path / "cones" / "scores").iterdir():
        path.unlink()
    again = benchmark.all_results(todo, ["range_only"], tmp_path / "cones")
    # All but the time that it took.
    rows = [row | {"ms_per_ping": 0.0} for row in rows if row["method"] == "range_only"]
    assert [row | {"ms_per_ping": 0.0} for row in benchmark.summary(again)] == rows


def test_conditions_are_varied_on_some_scenes_only(benchmark: ModuleType) -> None:
    todo = benchmark.cases(["poles", "corners"], None, [1])
    assert [case.row for case in todo].count(("corners", "plain")) == 1
    assert {case.condition for case in todo if case.scene == "poles"} == set(benchmark.VARIATIONS)
    assert set(benchmark.VARIATIONS) <= set(benchmark.CONDITIONS)
    assert {case.condition for case in todo if case.scene == "corners"} == {"plain"}


def test_the_readme_shows_ours_beside_range_only(benchmark: ModuleType) -> None:
    figures = {"f1": 0.5, "known": 0.75, "leak": 0.25, "lost": 0.125, "escape_m2": 2.0}
    rows = [
        {"scene": "rough_rooms", "condition": "plain", "method": method, "seeds": [3, 1], **figures}
        for method in ("ours", "range_only")
    ]
    lines = benchmark.readme_table(rows).splitlines()
    assert lines[2] == "| rough rooms |" + " 0.50 | 0.75 | 0.250 | 0.125 | 2.00 |" * 2
    assert lines[0].count("| known |") == 2
    assert lines[-1] == "Seeds: 1, 3."


def test_a_page_keeps_all_but_what_is_put_into_its_place(
    benchmark: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pages = importlib.import_module("pages")
    page = tmp_path / "page.md"
    page.write_text("before\n<!-- scores -->\nold\n<!-- /scores -->\nafter\n")
    monkeypatch.setattr(pages, "measured", lambda: "Measured with commit 1234567 of 2026-11-22.\n")
    pages.put(page, "scores", "new\n")
    assert page.read_text() == (
        "before\n<!-- scores -->\nnew\n\nMeasured with commit 1234567 of 2026-11-22.\n"
        "<!-- /scores -->\nafter\n"
    )
    with pytest.raises(ValueError, match="no place between <!-- times -->"):
        pages.put(page, "times", "new\n")

    monkeypatch.setattr(
        sys, "argv", ["/somewhere/scores.py", "--cache", "/own", "--seeds", "1", "-o", "out"]
    )
    drawn: list[Path] = []
    pages.put_with_picture(page, "scores", "table", "Scores", drawn.append)
    assert drawn == [tmp_path / "images" / "scores.png"]
    assert "\n    python benchmarks/scores.py --seeds 1\n" in page.read_text()
    assert "![Scores](images/scores.png)\n\ntable" in page.read_text()


def test_poses_may_be_taken_at_their_word(methods: ModuleType, scenes: ModuleType) -> None:
    recordings = importlib.import_module("recordings")
    world = scenes.scenario("poles", "poses_off", 1)
    world = world.model_copy(update={"duration_s": 0.2})
    method = methods.METHODS["no_covariance"]
    (_, cone), *_ = recordings.cones(world, method.parameters().reconstruction, None)
    assert cone.pose.planar_covariance.any()
    exact = methods._certain(cone, method.trusted_axes)
    assert not exact.pose.planar_covariance.any()
    straight = methods._certain(cone, methods.METHODS["no_heading"].trusted_axes)
    assert straight.pose.planar_covariance[2, 2] == 0.0
    assert straight.pose.planar_covariance[0, 0] == cone.pose.planar_covariance[0, 0]


def test_solvers_are_measured_by_the_objects_they_find(benchmark: ModuleType) -> None:
    solvers = importlib.import_module("solvers")
    places = solvers.Places(np.array([1.0, 1.01, 2.0, 2.5, 3.0]), np.full(5, 0.1))
    found, amplitudes = solvers.clusters(np.array([0.5, 1.0, 0.01, 0.6j, 0.0]), places)
    assert found.tolist() == [1.01, 2.5]
    assert amplitudes.tolist() == pytest.approx([0.1, 0.06])
    figures = solvers.accuracy("one", [found, np.zeros(0)], [np.array([1.0, 2.0]), np.array([1.0])])
    assert figures["one_found"] == pytest.approx(1 / 3)
    assert figures["one_false"] == 0.5
    assert figures["one_error_mm"] == pytest.approx(10.0)


def test_solvers_are_compared_where_equally_few_echoes_are_false(benchmark: ModuleType) -> None:
    solvers = importlib.import_module("solvers")
    heard = np.array([1.0, 2.0, 2.5, 3.0]), np.array([0.5, 0.3, 0.2, 0.1])
    truth = np.array([1.01, 3.02, 4.0])
    assert solvers.found_at(2.0, [heard], [truth]) == pytest.approx(2 / 3)
    assert solvers.found_at(1.0, [heard], [truth]) == pytest.approx(1 / 3)


def test_the_page_on_scaling_has_the_models_table(benchmark: ModuleType) -> None:
    fleets = importlib.import_module("fleets")
    costs = fleets.Costs(ms_reconstruction=1.0, ms_fusion=2.4, pings_hz=15.0, cores=8)
    assert fleets.table(costs) in (FOLDER.parent / "docs/scaling.md").read_text(encoding="utf-8")
    ten, thousand = (fleets.needs(robots, costs) for robots in (10, 1000))
    assert (ten["pings/s"], ten["fusions"], ten["hosts"]) == (150.0, 1, 1)
    # What is not by the fleet is by the robot.
    assert thousand["Mbit/s"] == pytest.approx(100.0 * ten["Mbit/s"])
    assert thousand["Mbit/s a fusion"] < 1.5 * ten["Mbit/s a fusion"]


@pytest.fixture
def echoes(benchmark: ModuleType) -> ModuleType:
    return importlib.import_module("echoes")


def test_the_same_echoes_are_told_from_others(echoes: ModuleType) -> None:
    cones = echoes.reconstructed("iq", 6)
    before = echoes.columns(cones)
    again = echoes.change(before, echoes.columns(echoes.reconstructed("iq", 6)))
    assert again.is_none
    assert again.pings == 6
    assert again.echoes > 6

    moved = {**before, "ranges_m": before["ranges_m"] + 2e-6}
    assert not echoes.change(before, moved).is_none
    louder = {**before, "amplitudes": before["amplitudes"] * 1.0001}
    assert not echoes.change(before, louder).is_none
    names = ("ranges_m", "range_stds_m", "amplitudes", "amplitude_stds")
    one_less = replace(cones[3], **{name: getattr(cones[3], name)[1:] for name in names})
    fewer = echoes.change(before, echoes.columns([*cones[:3], one_less, *cones[4:]]))
    assert not fewer.is_none
    assert fewer.same_count == 5


def test_echoes_of_other_pings_are_not_compared(echoes: ModuleType) -> None:
    few, more = (echoes.columns(echoes.reconstructed("iq", pings)) for pings in (3, 6))
    with pytest.raises(ValueError, match="other pings"):
        echoes.change(few, more)


@pytest.mark.usefixtures("benchmark")
def test_every_stage_is_a_function_that_there_is() -> None:
    stages = importlib.import_module("stages").STAGES
    missing = [
        name for timed in stages.values() for module, name in timed if not hasattr(module, name)
    ]
    assert missing == []


def test_a_symmetric_room_is_the_same_after_half_a_turn(scenes: ModuleType) -> None:
    world = scenes.scenario("symmetric", "plain", 5).world
    stands_m = [np.array(wall.corners_m) for wall in world.walls]
    stands_m.append(np.array([[pole.x_m, pole.y_m] for pole in world.points]))
    places_m = np.concatenate(stands_m)
    turned_m = 2.0 * places_m.mean(axis=0) - places_m
    apart_m = np.hypot(*(places_m[:, np.newaxis] - turned_m).T)
    assert apart_m.min(axis=0).max() < 1e-9


@pytest.mark.usefixtures("benchmark")
def test_where_a_robot_began_is_told_by_its_way() -> None:
    margins, origin = importlib.import_module("margins"), np.array([3.0, -1.0, 2.0])
    way = np.random.default_rng(1).uniform(-3.0, 3.0, (30, 3))
    found = margins.laid_over(way[:, :2], margins.compose(origin, way)[:, :2])
    np.testing.assert_allclose(found, origin, atol=1e-9)


@pytest.mark.usefixtures("benchmark")
def test_margins_are_counted_by_place() -> None:
    margins = importlib.import_module("margins")
    matches = [(True, 3.3, True), (True, 1.2, False), (False, 0.6, False), (True, 4.4, True)]
    lines = margins.table(matches).splitlines()
    assert lines[0] == "3 pairs in one place, 1 in different ones"
    assert "| 0.5 | 2 | 1 | 1 |" in lines
    assert "| 3.0 | 2 | 0 | 0 |" in lines
    assert "| 4.0 | 1 | 0 | 0 |" in lines


def test_whoever_counts_joined_robots_may_ask_for_every_kind_of_scene(scenes: ModuleType) -> None:
    joining = importlib.import_module("joining")
    kinds, parser = [*scenes.KINDS, *scenes.UNSCORED], joining.options(None, [7])
    assert parser.parse_args(["--kinds", *kinds]).kinds == kinds
    assert parser.parse_args([]).seeds == [7]
    with pytest.raises(SystemExit):
        parser.parse_args(["--kinds", "nothing"])
    for kind in kinds:
        scene = joining.unknown_starts(kind, 7, 50, 0.6)
        assert scene.duration_s == 5.0
        assert {robot.odometry.start for robot in scene.robots} == {"unknown"}


def test_robots_on_tour_come_into_all_rooms(scenes: ModuleType) -> None:
    tours = importlib.import_module("tours")
    scenario = scenes.scenario("flat_rough", "many_pings", 1)
    content = scenario.model_dump()
    for robot, motion in zip(content["robots"], tours.tours(scenario, 1), strict=True):
        robot["motion"] = motion
        places_m = np.array(motion["waypoints_m"])
        way_m = np.hypot(*np.diff(places_m, axis=0).T).sum()
        assert way_m >= motion["speed_m_s"] * scenario.duration_s
    on_tour = type(scenario).from_mapping(content, scenes.FLAT.parent / "on_tour.yaml")
    assert len(on_tour.fleet(on_tour.scene())) == 3
    # The flat's small room is in the south-east.
    for robot in on_tour.robots:
        x_m, y_m = np.array(robot.motion.waypoints_m).T
        is_inside = (x_m > 3.3) & (y_m < 2.4)
        assert is_inside.any()
        assert not is_inside.all()


def test_weights_of_cells_are_those_that_tell_best(benchmark: ModuleType) -> None:
    cell_odds = importlib.import_module("cell_odds")
    generator = np.random.default_rng(3)
    heard = generator.normal(size=(4000, len(cell_odds.log_odds.OF_FEATURES)))
    cells = cell_odds.Cells(heard, np.zeros(4000), np.zeros(4000, bool))
    chances = 1.0 / (1.0 + np.exp(-cell_odds.log_odds.heard_log_odds(cells.heard)))
    cells = cells._replace(are_surface=generator.random(4000) < chances)
    weights = cell_odds.fitted([cells], 1 + heard.shape[1])
    own = np.array([cell_odds.log_odds.INTERCEPT, *cell_odds.log_odds.OF_FEATURES])
    np.testing.assert_allclose(weights, own, atol=0.25)
    assert cell_odds.log_loss([cells], weights) < cell_odds.log_loss([cells], own)


def test_suspected_cells_know_what_stands_there(benchmark: ModuleType) -> None:
    cells = importlib.import_module("cell_odds").suspected_cells("poles", "few_pings", 3, None)
    assert np.isfinite(cells.heard).all()
    assert np.isfinite(cells.log_power).all()
    # Most of what is suspected among poles is one, or beside it.
    assert cells.are_surface.mean() > 0.5
