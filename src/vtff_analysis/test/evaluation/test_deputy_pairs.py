"""Deputies relative to each other, and the ionosphere of each pair with the chief."""

import numpy as np
import pytest

pytest.importorskip("rclpy")

from vtff_analysis.evaluation.deputy_pairs import (  # noqa: E402
    normalised_error,
    pair_error,
    summarise_pairs,
)
from vtff_analysis.recordings.history import (  # noqa: E402
    DeputyHistory,
    NavigationHistory,
    RelativeStateHistory,
    RunHistory,
)
from vtff_analysis.recordings.recording_details import DetailCollector  # noqa: E402
from vtff_msgs.msg import ElectronDensity, IrregularityBoundary  # noqa: E402

SECOND = 10**9
EPOCHS = 5000
SIGMA = 1e-3  # m, of each axis and receiver


def deputies(*positions):
    """Deputies whose filters have independent receivers and the chief's in common."""
    generator = np.random.default_rng(1)
    time = np.arange(EPOCHS, dtype=np.int64) * SECOND
    chief = SIGMA * generator.standard_normal((EPOCHS, 3))
    made = {}
    for name, position in zip("bcdefg", positions, strict=False):
        true = np.tile(np.asarray(position, dtype=float), (EPOCHS, 1))
        error = SIGMA * generator.standard_normal((EPOCHS, 3)) - chief
        still, count = np.zeros((EPOCHS, 3)), np.zeros(EPOCHS)
        covariance = np.tile(2.0 * SIGMA**2 * np.eye(3), (EPOCHS, 1, 1))
        navigation = NavigationHistory(
            time, still, still, count, count, count, count, count, covariance
        )
        made[name] = DeputyHistory(
            name,
            truth=RelativeStateHistory(time, true, still),
            estimate=RelativeStateHistory(time, true + error, still),
            navigation=navigation,
        )
    return made


def test_difference_of_two_deputies_is_honest():
    both = deputies([0.0, 100.0, 0.0], [0.0, -150.0, 0.0])
    error = pair_error(both["b"], both["c"])
    assert len(error.position_rtn) == EPOCHS - 60
    assert error.separation[0] == 250.0
    summary = summarise_pairs(both)
    assert summary["pair_b_c_minimum_separation_m"] == 250.0
    rms = np.sqrt(3.0 * 2.0) * SIGMA
    assert summary["pair_b_c_error_settled_3d_rms_m"] == pytest.approx(rms, rel=0.03)
    assert summary["pair_b_c_error_settled_nees"] == pytest.approx(1.0, abs=0.05)


def test_every_two_deputies_are_a_pair():
    summary = summarise_pairs(deputies([0, 100, 0], [0, 200, 0], [0, 300, 0], [0, 450, 0]))
    names = [key for key in summary if key.endswith("minimum_separation_m")]
    assert len(names) == 6 and summary["pair_d_e_minimum_separation_m"] == 150.0
    assert summarise_pairs(deputies([0, 100, 0])) == {}


def test_without_navigation_or_covariance():
    both = deputies([0, 100, 0], [0, 200, 0])
    both["c"] = DeputyHistory("c", truth=both["c"].truth)
    assert pair_error(both["b"], both["c"]) is None
    assert list(summarise_pairs(both)) == ["pair_b_c_minimum_separation_m"]
    assert normalised_error(np.ones((2, 3)), np.zeros((2, 3, 3))) is None


def test_ionosphere_of_each_pair():
    details = DetailCollector()
    for name, density in (("b", 1e11), ("c", 2e11)):
        message = ElectronDensity(
            child_frame_id=name, position=[6.9e6, 0.0, 0.0], system=[255], prn=[0]
        )
        message.density, message.density_sigma = [density], [1e9]
        details.handler(f"/{name}/iono/electron_density")(message)
        edge = IrregularityBoundary(child_frame_id=name, spacecraft="a", prn=5)
        details.handler(f"/{name}/iono/irregularity_boundary")(edge)
    history = RunHistory(0, SECOND, {}, chief="a", pairs=details.pairs())
    seen = {pair.deputy: pair.density.density.tolist() for pair in history.pair_histories()}
    assert seen == {"b": [1e11], "c": [2e11]}
    assert [len(pair.boundaries) for pair in history.pair_histories()] == [1, 1]
    assert history.of_pair("d").density is None
