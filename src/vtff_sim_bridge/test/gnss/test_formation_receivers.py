"""GNSS files of formations: receivers named as their spacecraft, files that extend others."""

import dataclasses
import pathlib

import pytest

from vtff_sim_bridge.gnss.configuration import assign_vehicles, load_gnss_configuration
from vtff_sim_bridge.truth.scenario_fields import ScenarioError

GNSS = pathlib.Path(__file__).parents[4] / "config/gnss"
VEHICLES = {"alpha": "v1_m1", "bravo": "v2_m1", "charlie": "v3_m1"}


def test_receivers_are_on_the_vehicles_of_their_spacecraft():
    configuration = assign_vehicles(
        load_gnss_configuration(GNSS / "formation_three.yaml"), VEHICLES
    )
    assert {r.name: r.vehicle for r in configuration.receivers} == VEHICLES


def test_a_file_has_the_world_of_the_one_it_extends():
    three = load_gnss_configuration(GNSS / "formation_three.yaml")
    realistic = load_gnss_configuration(GNSS / "realistic.yaml")
    for name in ("constellation", "structures", "seed"):
        assert getattr(three, name) == getattr(realistic, name)
    assert three.receivers[0].multipath == realistic.receivers[0].multipath
    assert three.name == "formation_three"


@pytest.mark.parametrize(
    ("name", "vehicle", "text"),
    [
        (
            "delta",
            "",
            "receiver delta: there is no spacecraft of that name; the scenario has alpha",
        ),
        (
            "bravo",
            "v3_m1",
            "receiver bravo: vehicle is v3_m1, but the spacecraft of that name is v2",
        ),
    ],
)
def test_receivers_of_other_spacecraft_are_refused(name, vehicle, text):
    configuration = load_gnss_configuration(GNSS / "formation_three.yaml")
    receivers = list(configuration.receivers)
    receivers[1] = dataclasses.replace(receivers[1], name=name, vehicle=vehicle)
    with pytest.raises(ScenarioError, match=text):
        assign_vehicles(dataclasses.replace(configuration, receivers=tuple(receivers)), VEHICLES)


@pytest.mark.parametrize("extended", ["../realistic.yaml", "b.yaml", 3])
def test_wrong_extension_is_refused(tmp_path, extended):
    file = tmp_path / "b.yaml"
    file.write_text(f"extends: {extended}\n")
    with pytest.raises(ScenarioError, match="b.yaml: extends: another file of the same folder"):
        load_gnss_configuration(file)
