"""The paper's figures, regenerated: the numbers behind them."""

import json
from pathlib import Path

import numpy as np
import pytest

from usmap_ros.errors import FileError
from usmap_ros.paper.setting import ALIGNED, CELL_M, CENTRES, MIRROR_IMAGES, OBJECTS
from usmap_ros.paper.solver_study import NAMES
from usmap_ros.paper.study import NUMBERS_FILE, PARTS, run_study

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    folder = tmp_path_factory.mktemp("paper")
    done = []
    numbers = run_study(folder, lambda: done.append(1))
    assert len(done) == len(PARTS)
    return folder, numbers


def test_numbers_are_written_as_they_are(study):
    folder, numbers = study
    written = json.loads((folder / NUMBERS_FILE).read_text())

    assert written == json.loads(json.dumps(numbers))
    assert set(written) - {"seconds"} == {path.stem for path in folder.glob("*.png")}


def test_every_picture_is_one(study):
    from PIL import Image

    folder, _ = study
    pictures = list(folder.glob("*.png"))
    assert len(pictures) == len(PARTS)
    for path in pictures:
        with Image.open(path) as image:
            assert min(image.size) > 300
            assert len(image.convert("RGB").getcolors(maxcolors=1_000_000)) > 50


def test_every_picture_is_in_the_docs_with_a_caption(study):
    docs = Path(__file__).parents[3] / "docs"
    text = (docs / "paper.md").read_text()

    for path in study[0].glob("*.png"):
        assert (docs / "figures" / path.name).is_file()
        _, _, after = text.partition(f"](figures/{path.name})")
        assert after.startswith("\n\n*"), path.name


def test_every_statement_of_every_caption_holds(study):
    captions = {
        (part, words): one["holds"]
        for part, numbers in study[1].items()
        if part != "seconds"
        for words, one in numbers.get("caption", {}).items()
    }

    assert len(captions) > 30
    assert [name for name, holds in captions.items() if holds is not True] == []


def test_every_picture_of_the_paper_is_there(study):
    figures = {name.split("_")[1] for name in study[1] if name.startswith("figure_")}

    assert figures == {"1a", "1b", "2", "3", "4", "5", "6", "7", "8"}


def test_figure_2_linear_pattern_falls_to_nothing_at_40_degrees(study):
    numbers = study[1]["figure_2_beam_patterns"]

    assert numbers["half_angle_deg"]["linear"] == pytest.approx(40.0)
    assert numbers["gains"]["linear"] == pytest.approx([1.0, 0.875, 0.75, 0.5, 0.25, 0.0])
    assert numbers["half_gain_deg"]["SensComp 600"] < numbers["half_gain_deg"]["linear"]


def test_figure_3_columns_are_identical_only_when_aligned(study):
    numbers = study[1]["figure_3_sensing_matrix"]

    aligned, oblique = numbers["aligned"], numbers["oblique"]
    # All but the ten cells on the axis.
    assert aligned["identical"] == aligned["cells"] - 10
    assert oblique["identical"] == 0
    assert aligned["multiples"] >= aligned["identical"]
    assert numbers["cells"] == aligned["cells"]


def test_figure_4_pulses_come_back_when_and_as_loud_as_they_should(study):
    numbers = study[1]["figure_4_scene_and_pulse_train"]
    ranges_m, bearings = ALIGNED.polar(np.array(OBJECTS))
    gains = 1.0 - np.abs(bearings) / np.deg2rad(40.0)

    np.testing.assert_allclose(numbers["delays_ms"], 2e3 * ranges_m / 343.0)
    np.testing.assert_allclose(numbers["amplitudes"], gains / ranges_m**2, rtol=1e-6)


def test_figure_5_shows_the_true_cells_and_their_mirror_images_and_nothing_else(study):
    numbers = study[1]["figure_5_reconstruction"]
    found = {(cell["x_m"], cell["y_m"]): cell["coefficient"] for cell in numbers["coefficients"]}

    expected = dict.fromkeys([*CENTRES, *MIRROR_IMAGES], 0.5) | {CENTRES[2]: 1.0}
    # The objects are a centimetre off the centres of their cells.
    assert found == pytest.approx(expected, abs=0.01)
    assert numbers["relative_residual"] < 1e-6
    assert numbers["f1"] == 1.0


def test_figure_7_one_way_over_the_floor_counts_twice(study):
    numbers = study[1]["figure_7_floor_interference"]
    delays, amplitudes = (np.array(numbers[name]) for name in ("path_delays_ms", "path_amplitudes"))

    np.testing.assert_allclose(delays[:, 0] + delays[:, 2], 2.0 * delays[:, 1])
    np.testing.assert_allclose(4.0 * amplitudes[:, 0] * amplitudes[:, 2], amplitudes[:, 1] ** 2)
    assert numbers["relative_energy_of_the_floor"] > 0.1


def test_figure_8_objects_are_not_at_the_centres_of_cells(study):
    numbers = study[1]["figure_8_simple_and_multipath"]

    offsets = np.array(numbers["objects_m"]) % 1.0 - 0.5
    assert np.hypot(*offsets.T).min() > 0.005
    assert len(numbers["simple"]["coefficients"]) == 15
    assert len(numbers["multipath"]["coefficients"]) == 15
    assert numbers["multipath"]["f1"] == 1.0
    assert numbers["simple"]["f1"] < 0.7


def test_figure_8_holds_about_its_setting_as_long_as_offsets_are_small(study):
    numbers = study[1]["figure_8_range"]
    about = numbers["shares"]["about figure 8"]["all of them"]

    assert numbers["offsets_in_wavelengths"] == sorted(numbers["offsets_in_wavelengths"])
    assert about[0] > 0.6
    assert about[-1] < 0.2
    for shares in numbers["shares"].values():
        found = shares["the multipath Φ finds all objects, up to symmetry"]
        assert found[0] == 1.0
        assert found[-1] < 0.5


def test_two_ways_of_looking_break_the_symmetry_and_two_pulses_alone_do_not(study):
    numbers = study[1]["beyond_two_transducers"]

    assert numbers["other_pulses_one_way"]["weight_elsewhere"] == pytest.approx(1.5, abs=1e-6)
    for pair in ("other_ways_one_pulse", "other_ways_and_pulses_at_once"):
        assert numbers[pair]["identical_columns"] == 0
        assert numbers[pair]["weight_at_objects"] == pytest.approx([1.0] * 3, abs=1e-6)
        assert numbers[pair]["weight_elsewhere"] == pytest.approx(0.0, abs=1e-6)


def test_whole_and_binary_coefficients_are_right_where_they_fit(study):
    numbers = study[1]["beyond_kinds_of_coefficients"]

    one = numbers["one object in a cell"]
    assert one["binary"]["rms_error"] == 0.0
    assert one["whole"]["rms_error"] == 0.0
    assert numbers["one object in a cell, or two"]["whole"]["rms_error"] == 0.0
    differing = numbers["reflectivities differ"]
    assert differing["not negative"]["rms_error"] < 0.05
    assert differing["not negative"]["rms_error"] < differing["whole"]["rms_error"]


def test_finer_cells_need_faster_sampling(study):
    shares = np.array(study[1]["beyond_grid_size_and_rate"]["share_told_apart"])

    assert np.all(np.diff(shares, axis=1) >= -0.02)
    assert shares[0, 0] < 0.05
    assert shares[-1, -1] == 1.0


def test_calibration_from_the_recording_mends_a_wrong_floor(study):
    numbers = study[1]["beyond_mismatched_floor"]
    before, after = numbers["error_before"], numbers["error_after"]

    assert after["sound_speed_m_s"] < 0.1 * before["sound_speed_m_s"]
    assert after["floor_height_m"] < 0.1 * before["floor_height_m"]
    assert after["floor_reflectivity"] < 0.2 * before["floor_reflectivity"]
    assert (
        numbers["calibrated"]["false_echoes_per_ping"]
        < 0.2 * numbers["stated"]["false_echoes_per_ping"]
    )
    assert numbers["calibrated"]["median_range_error_m"] < 0.002
    assert numbers["calibrated"]["map_f1"] > numbers["stated"]["map_f1"]
    carpet = numbers["carpet_for_concrete"]
    assert carpet["carpet"]["relative_residual"] < 1e-6
    assert carpet["concrete"]["relative_residual"] > 0.1


def test_off_the_centres_only_the_delay_domain_still_works(study):
    numbers = study[1]["beyond_objects_off_the_centres"]
    cells, delays = numbers["cells"], numbers["delay_domain"]

    assert numbers["offsets_m"][-1] == CELL_M / 2.0
    assert cells["f1"][0] == 1.0
    assert cells["f1"][-1] < 0.2
    assert cells["relative_residual"][-1] > 0.9
    assert min(delays["f1"]) > 0.95
    assert max(delays["relative_residual"]) < 0.1


def test_solvers_agree_without_noise_and_few_objects(study):
    rows = study[1]["solvers_table"]["rows"]
    solvers = {row["solver"] for row in rows}

    assert solvers == set(NAMES)
    for row in rows:
        if row["noise_std"] == 0.0 and row["solver"] != "tv":
            assert row["support_found"] == 1.0, row
        assert row["milliseconds"] > 0.0


def test_more_samples_recover_more_objects(study):
    numbers = study[1]["solvers_phase_transition"]

    for solver, probability in numbers["probability"].items():
        shares = np.array(probability)
        assert shares[0].min() > 0.8, solver
        assert shares[-1, 0] < 0.5, solver
        assert shares.mean(axis=0)[-1] > shares.mean(axis=0)[0]


def test_folder_that_cannot_be_made_is_named(tmp_path):
    occupied = tmp_path / "file"
    occupied.write_text("")
    with pytest.raises(FileError, match="file"):
        run_study(occupied)
