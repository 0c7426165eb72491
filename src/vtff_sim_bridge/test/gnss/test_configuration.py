"""GNSS files: the ones of the repository, and that nothing wrong is taken silently."""

from __future__ import annotations

import gnss_emulator_support as support
import pytest

from vtff_sim_bridge.gnss.configuration import load_gnss_configuration
from vtff_sim_bridge.gnss.faults import FAULT_KINDS
from vtff_sim_bridge.truth.scenario_fields import ScenarioError

MINIMAL = """\
name: minimal
seed: 3
receiver_defaults:
  cn0_zenith_dbhz: {G1C: 45.0}
receivers:
  - {name: chief, vehicle: V1_M1}
"""


def test_faults_of_the_readme_load_and_are_all_there_are(tmp_path):
    readme = (support.REPOSITORY / "src" / "vtff_sim_bridge" / "README.md").read_text("utf-8")
    _, _, block = readme.partition("```yaml\nfaults:\n")
    faults = "faults:\n" + block.partition("```")[0]
    path = tmp_path / "gnss.yaml"
    text = MINIMAL + "  - {name: deputy, vehicle: v2_m1}\n" + faults
    path.write_text(text, encoding="utf-8")
    loaded = load_gnss_configuration(path)
    assert sorted(fault.kind for fault in loaded.faults) == sorted(FAULT_KINDS)


@pytest.mark.parametrize("name", ["noise_free", "reference", "benchmark"])
def test_files_of_the_repository_load(name):
    loaded = support.configuration(name)
    assert [receiver.name for receiver in loaded.receivers] == ["chief", "deputy"]
    assert loaded.name == name


def test_defaults_hold_where_nothing_is_given(tmp_path):
    path = tmp_path / "gnss.yaml"
    path.write_text(MINIMAL, encoding="utf-8")
    loaded = load_gnss_configuration(path)
    receiver = loaded.receivers[0]
    assert receiver.vehicle == "v1_m1" and receiver.noise.model == "cn0"
    assert loaded.profile is None and loaded.regions == () and loaded.faults == ()
    assert loaded.constellation.source == "nominal"


def test_a_receiver_overrides_the_defaults(tmp_path):
    path = tmp_path / "gnss.yaml"
    text = MINIMAL.replace("V1_M1}", "v1_m1, cn0_zenith_dbhz: {G2S: 40.0}, tcp_port: 0}")
    path.write_text(text, encoding="utf-8")
    receiver = load_gnss_configuration(path).receivers[0]
    assert dict(receiver.cn0_zenith_dbhz) == {"G2S": 40.0}
    assert receiver.tcp_port == 0


@pytest.mark.parametrize(
    ("old", "new", "named"),
    [
        ("seed: 3", "seed: -3", "seed"),
        ("name: minimal\n", "", "name"),
        ("seed: 3", "seed: 3\nsed: 4", "sed"),
        ("G1C: 45.0", "G9Z: 45.0", "cn0_zenith_dbhz.G9Z"),
        ("G1C: 45.0", "G1C: strong", "cn0_zenith_dbhz.G1C"),
        ("{G1C: 45.0}", "{}", "cn0_zenith_dbhz"),
        ("chief, vehicle", "a/b, vehicle", "name"),
        ("V1_M1}", "v1_m1, clock: {oscillator: quartz}}", "oscillator"),
        ("V1_M1}", "v1_m1, noise: {sigma: 1.0}}", "sigma"),
        ("V1_M1}", "v1_m1, tracking: {channels: 0}}", "channels"),
        ("V1_M1}", "v1_m1, generation: OEM9}", "generation"),
        ("V1_M1}", "v1_m1}\n  - {name: chief, vehicle: v2_m1}", "receivers"),
        ("seed: 3", "seed: 3\nfaults: [{kind: slip, receiver: x, time: 1, cycles: 1}]", "receiver"),
        ("seed: 3", "seed: 3\natmosphere: {electron_density: {table: no.csv}}", "no.csv"),
    ],
)
def test_what_is_wrong_is_refused_by_name(tmp_path, old, new, named):
    path = tmp_path / "gnss.yaml"
    assert old in MINIMAL
    path.write_text(MINIMAL.replace(old, new, 1), encoding="utf-8")
    with pytest.raises(ScenarioError, match=named) as error:
        load_gnss_configuration(path)
    assert str(path) in str(error.value) and "\n" not in str(error.value)
