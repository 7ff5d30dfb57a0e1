"""Scenario files: what they accept, what they refuse and how they say so."""

import re

import numpy as np
import pytest

from usmap_ros.acoustics.medium import Air
from usmap_ros.errors import ConfigurationError, MapFileError
from usmap_ros.pings.trace import Encoding
from usmap_ros.simulation import Scenario, simulate

MINIMAL = {
    "world": {"area_m": [0, 10, 0, 10], "points": [{"x_m": 1, "y_m": 2}]},
    "robots": [{"name": "robot1"}],
}


def scenario(**changes):
    return Scenario.from_mapping(MINIMAL | changes, "file.yaml")


def robot(**changes):
    return {"robots": [{"name": "robot1"} | changes]}


def resonant(quality, duration_s=0.0003):
    resonances = [{"frequency_hz": 1e6, "quality": quality}]
    return {"pulse": {"duration_s": duration_s, "resonances": resonances}}


def test_a_minimal_one_has_sensible_defaults():
    topic, trace = next(simulate(scenario()))
    trace.validate()
    assert topic == "/robot1/echo"
    assert trace.frame_id == "map"
    assert trace.encoding is Encoding.IQ


@pytest.mark.parametrize(
    ("changes", "named"),
    [
        ({"sed": 3}, "sed"),
        ({"duration_s": 0.0}, "duration_s"),
        ({"duration_s": "long"}, "duration_s"),
        ({"robots": []}, "robots"),
        ({"robots": [{"name": "a"}, {"name": "a"}]}, "'a'"),
        (robot(name="a/b"), "name"),
        (robot(transducers=[{"name": "s"}, {"name": "s"}]), "'s'"),
        (robot(transducers=[{"min_range_m": 6.0}]), "max_range"),
        (robot(transducers=[{"beam": {"kind": "cone"}}]), "beam"),
        (
            robot(
                transducers=[{"beam": {"kind": "table", "angles_rad": [0, 1], "gains": [1, -1]}}]
            ),
            "beam.gains: must be 0 or more",
        ),
        (robot(motion={"kind": "waypoints", "waypoints_m": []}), "waypoints_m"),
        ({"world": {"area_m": [1, 0, 0, 1]}}, "area_m"),
        ({"world": {"walls": [{"corners_m": [[0, 0]]}]}}, "corners_m"),
        ({"world": {"walls": [{"corners_m": [[0, 0], [0, 0]]}]}}, "no length"),
        ({"world": {"walls": [{"corners_m": [[0, 0], [float("nan"), 0]]}]}}, "corners_m"),
        ({"world": {"points": [{"x_m": float("inf"), "y_m": 0}]}}, "x_m"),
        (robot(transducers=[{"receiver": {"noise_std": float("nan")}}]), "noise_std"),
        ({"medium": {"temperature_c": 300.0}}, "temperature_c"),
        ({"medium": {"temperature_c": 30.0, "sound_speed_m_s": 343.0}}, "medium.sound_speed_m_s: "),
        # What would take terabytes, or for ever.
        ({"stated": {"floor_height_m": 1e5}}, "stated.floor_height_m"),
        (robot(transducers=[resonant(quality=1e-9)]), "resonances.0.quality"),
        (robot(transducers=[resonant(quality=0.5, duration_s=0.2)]), "500000 are taken"),
        (robot(motion={"kind": "random_walk", "step_s": 1e-9}), "step_s"),
        # Also if it says no more than what it would be without a word.
        ({"medium": {"temperature_c": 20.0, "sound_speed_m_s": 343.0}}, "medium.sound_speed_m_s: "),
    ],
)
def test_what_cannot_be_is_refused_in_one_line(changes, named):
    with pytest.raises(ConfigurationError, match=named) as refusal:
        scenario(**changes)
    assert str(refusal.value).startswith("file.yaml: ")
    assert "\n" not in str(refusal.value)


@pytest.mark.parametrize(
    ("changes", "named"),
    [
        (
            robot(motion={"kind": "waypoints", "waypoints_m": [[0, 2], [3, 2]]}),
            "robots.0.motion: .*waypoint 0.*robot1",
        ),
        (robot(motion={"kind": "random_walk", "start": [1, 2, 0]}), "motion: there is no room"),
        (
            robot(motion={"kind": "random_walk", "start": [50, 50, 0]}),
            r"robots.0.motion.start: \(50, 50\) is outside of the world",
        ),
        (
            robot(motion={"kind": "waypoints", "waypoints_m": [[5, 5], [5, -1]]}),
            r"robots.0.motion.waypoints_m: \(5, -1\) is outside of the world",
        ),
        (
            robot(transducers=[{"receiver": {"encoding": "raw", "sample_rate_hz": 6e4}}]),
            "robots.0.transducers.0.receiver.sample_rate_hz: raw samples at 60000 Hz",
        ),
        ({"world": {}}, "area_m"),
        (robot(transducers=[{"receiver": {"start_delay_s": 1.0}}]), "receiver"),
        (robot(transducers=[{"receiver": {"sample_rate_hz": 1e8}, "max_range_m": 50}]), "samples"),
        (robot(transducers=[{"receiver": {"sample_rate_hz": 1000}}]), "sample_rate_hz"),
        (
            {"world": {"area_m": [0, 1, 0, 1], "random_poles": {"count": 99, "separation_m": 1}}},
            "of 99 fit",
        ),
        (
            {"world": {"walls": [{"corners_m": [[-1e5, 0], [1e5, 0]]}]}},
            r"world.walls: scatter from 8e\+06 points",
        ),
    ],
)
def test_what_has_no_place_is_refused_in_one_line(changes, named):
    with pytest.raises(ConfigurationError, match=named) as refusal:
        next(simulate(scenario(**changes)))
    assert str(refusal.value).startswith("file.yaml: ")


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        (
            robot(motion={"kind": "walk"}),
            "robots.0.motion.kind: should be one of 'waypoints', 'ran",
        ),
        (robot(motion={"waypoints_m": [[1, 2]]}), "robots.0.motion.kind: is missing"),
        (
            robot(motion={"kind": "random_walk", "start": [5, 5]}),
            "robots.0.motion.start: should have more entries, has 2",
        ),
        (
            {"world": {"walls": [{"corners_m": [[0, 0]]}]}},
            "world.walls.0.corners_m: should have at least 2 entries, has 1",
        ),
        (robot(name="a/b"), "robots.0.name: should begin with a letter, and be letters, digits"),
        ({"robots": {"name": "a"}}, "robots: should be a list"),
        (robot(transducers=[{"mount": 3}]), "robots.0.transducers.0.mount: should be keys with"),
        (robot(transducers=[{"min_range_m": 6.0}]), "transducers.0.max_range_m: is 5 m, must be"),
        ({"crosstalk": "maybe"}, "crosstalk: should be true or false (is 'maybe')"),
        ({"seed": 1.5}, "seed: should be a whole number (is 1.5)"),
    ],
)
def test_mistakes_are_told_in_words_for_people(changes, told):
    with pytest.raises(ConfigurationError, match=re.escape(told)):
        scenario(**changes)


def test_a_world_without_an_edge_has_no_outside():
    far = robot(motion={"kind": "waypoints", "waypoints_m": [[50, 50], [60, 60]]})
    next(simulate(scenario(world={"points": [{"x_m": 1, "y_m": 2}]}, **far)))


def test_a_name_that_no_file_can_have_is_named(tmp_path):
    with pytest.raises(MapFileError, match="is not the name of a file") as refusal:
        scenario(world={"map": {"path": "\0"}}).scene()
    assert "\0" not in str(refusal.value)
    with pytest.raises(MapFileError) as refusal:
        scenario(world={"map": {"path": "x" * 100_000}}).scene()
    assert len(str(refusal.value)) < 1000


def test_a_missing_map_is_named(tmp_path):
    world = {"map": {"path": "nowhere.yaml"}}
    missing = Scenario.from_mapping(MINIMAL | {"world": world}, tmp_path / "file.yaml")
    with pytest.raises(MapFileError, match=r"nowhere\.yaml"):
        missing.scene()


def test_files_are_read_and_their_mistakes_named(tmp_path):
    path = tmp_path / "mine.yaml"
    path.write_text("seed: 4\nrobots:\n  - {name: robot1}\nworld: {area_m: [0, 1, 0, 1]}\n")
    assert Scenario.load(path).seed == 4
    path.write_text("robots:\n  - {nme: robot1}\n")
    with pytest.raises(ConfigurationError, match=r"mine\.yaml: robots\.0\.n"):
        Scenario.load(path)
    with pytest.raises(ConfigurationError, match="does not exist"):
        Scenario.load(tmp_path / "none.yaml")


def test_the_weather_makes_sound_speed_and_absorption():
    weather = {"temperature_c": 5.0, "relative_humidity": 0.9}
    _, trace = next(simulate(scenario(medium=weather)))
    air = Air(5.0, 0.9)
    assert trace.channel.sound_speed_m_s == air.sound_speed_m_s()
    assert trace.channel.attenuation_db_m == air.attenuation_db_m(50_000.0)


def test_stated_values_override_the_truth_in_messages_only():
    floor = {"floor_reflectivity": 0.6, "sound_speed_m_s": 340.0}
    mount = robot(transducers=[{"mount": {"z_m": 0.5}}])
    stated = {"sound_speed_m_s": 350.0, "floor_reflectivity": 0.2, "noise_std": 0.0}
    _, honest = next(simulate(scenario(medium=floor, **mount)))
    _, wrong = next(simulate(scenario(medium=floor, stated=stated, **mount)))
    assert (honest.channel.floor_height_m, honest.channel.floor_reflectivity) == (0.5, 0.6)
    assert (wrong.channel.sound_speed_m_s, wrong.channel.floor_reflectivity) == (350.0, 0.2)
    assert wrong.channel.floor_height_m == 0.5
    assert (honest.noise_std, wrong.noise_std) == (0.01, 0.0)
    np.testing.assert_array_equal(honest.samples, wrong.samples)


def test_random_poles_keep_apart_and_have_the_spread_that_is_asked_for():
    world = {
        "area_m": [0, 40, 0, 40],
        "random_poles": {"count": 500, "separation_m": 0.5, "reflectivity_spread": 0.35},
        "walls": [{"corners_m": [[0, 20], [40, 20]]}],
    }
    scene = scenario(world=world).scene()
    centers = scene.discs.centers_m
    apart = np.hypot(*(centers[:, np.newaxis] - centers).T) + 9.0 * np.eye(500)
    assert apart.min() >= 0.5
    assert np.abs(centers[:, 1] - 20.0).min() >= 0.25
    logarithms = np.log(scene.discs.reflectivities)
    assert logarithms.mean() == pytest.approx(0.0, abs=0.05)
    assert logarithms.std() == pytest.approx(0.35, rel=0.1)


def test_a_truth_map_that_nothing_can_hold_is_refused():
    wide = scenario(world={"area_m": [0, 9e4, 0, 10]})
    with pytest.raises(ConfigurationError, match="coarser"):
        wide.truth_map(0.05)


def test_every_field_says_what_it_is():
    schema = Scenario.model_json_schema()
    groups = [schema, *schema["$defs"].values()]
    for group in groups:
        for name, field in group.get("properties", {}).items():
            assert field.get("description"), f"{group['title']}.{name} has no description"
            assert "unit" in field, f"{group['title']}.{name} has no unit"
