"""Receiver biases in /diagnostics."""

from types import SimpleNamespace

from vtff_iono.ionosphere_processor_node import describe_receiver_biases
from vtff_node import diagnostics


def spacecraft(biases, error):
    return SimpleNamespace(receiver_biases=biases, bias_error=error)


BIASES = {(0, "C1C", "C2W"): None}


def test_biases_that_are_estimated_or_not_yet_due_are_no_warning():
    both = {"chief": spacecraft(BIASES, None), "deputy": spacecraft(BIASES, None)}
    assert describe_receiver_biases(both, 600.0) == (diagnostics.OK, "receiver biases estimated")
    level, text = describe_receiver_biases(both | {"deputy": spacecraft({}, None)}, 600.0)
    assert level == diagnostics.OK
    assert "deputy" in text and "600 s" in text and "'bias_delay'" in text


def test_an_estimate_that_fails_is_a_warning_with_its_reason():
    reason = "receiver bias: only 3 pairs of satellites above 30 deg"
    level, text = describe_receiver_biases(
        {"chief": spacecraft({}, reason), "deputy": spacecraft(BIASES, reason)}, 600.0
    )
    assert level == diagnostics.WARN
    assert text == (
        f"chief has no receiver bias ({reason}); deputy has an old receiver bias ({reason})"
    )
