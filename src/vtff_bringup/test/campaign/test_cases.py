"""The cases of a campaign: grid, samples and seeds."""

from __future__ import annotations

from campaign_samples import changed, write_campaign

from vtff_bringup.campaign.campaign_file import load_campaign
from vtff_bringup.campaign.cases import make_cases


def cases_of(folder, content=None):
    return make_cases(load_campaign(write_campaign(folder, content)))


def test_every_point_of_the_grid_meets_every_sample_and_seed(tmp_path):
    cases = cases_of(tmp_path, changed("seeds", [5, 6]))
    assert [case.number for case in cases] == list(range(1, 17))
    assert [case.inputs["cap"] for case in cases] == [1.2] * 8 + [1.4] * 8
    assert [case.seed for case in cases] == [5, 6] * 8
    starts = [case.inputs["start"] for case in cases]
    assert starts[:8] == starts[8:] and starts[0:8:2] == starts[1:8:2]
    assert len(set(starts)) == 4


def test_a_variable_sets_all_its_keys(tmp_path):
    first = cases_of(tmp_path)[0]
    assert first.settings == {
        "sdre_controller.acceleration_cap": 1.2,
        "thruster.acceleration_cap": 1.2,
        "scenario.spacecraft.deputy.orbit.relative_rtn.position.1": first.inputs["start"],
    }


def test_partners_go_one_by_one(tmp_path):
    content = changed("vary/design", {"sets": ["a.b"], "values": ["x", "y"], "with": "cap"})
    pairs = {(case.inputs["cap"], case.inputs["design"]) for case in cases_of(tmp_path, content)}
    assert pairs == {(1.2, "x"), (1.4, "y")}


def test_seeds_of_cases_come_from_the_campaign_s_seed_and_the_number(tmp_path):
    seeds = [case.seed for case in cases_of(tmp_path)]
    assert len(set(seeds)) == len(seeds) and all(0 <= seed < 2**31 for seed in seeds)
    assert seeds == [case.seed for case in cases_of(tmp_path, changed("seed", 1))]
    assert seeds != [case.seed for case in cases_of(tmp_path, changed("seed", 2))]
    more = cases_of(tmp_path, changed("vary/cap/values", [1.2, 1.4, 1.6]))
    assert [case.seed for case in more][:8] == seeds


def test_a_campaign_without_variables_repeats_one_case(tmp_path):
    cases = cases_of(tmp_path, changed("seeds", 3, changed("samples", None, changed("vary", None))))
    assert [case.settings for case in cases] == [{}, {}, {}]
    assert len({case.seed for case in cases}) == 3
