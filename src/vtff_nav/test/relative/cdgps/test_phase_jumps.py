"""Phases that jump without a loss of lock: found, put out, nothing wrong called fixed."""

from __future__ import annotations

import numpy as np
import pytest
from jump_worlds import CONVERGED, MOTIONS, Jump, draw_jump, fly_jump, world

from vtff_gnss.signals import SignalKey
from vtff_nav.relative.cdgps import phase_jumps
from vtff_nav.relative.cdgps.phase_jumps import PhaseChanges, PhaseJumpDetector

# Normalised error of a position, all three axes, beyond which it must not be called fixed.
LARGEST = 5.0
SHORT, LONG = 4, 50
# Flights after the jump, s: the satellite stays away; it comes back.
WITHOUT_IT, UNTIL_IT_IS_BACK = 60, 340


def fly_drawn(motion: str, count: int, seconds: int = 16, seed: int = 7) -> list[str]:
    """Return the drawn jumps with a wrong position that was called fixed."""
    generator = np.random.default_rng(seed)
    jumps = [draw_jump(generator, motion) for _ in range(count)]
    return [str(jump) for jump in jumps if fly_jump(jump, seconds).largest > LARGEST]


@pytest.mark.parametrize("motion", MOTIONS)
def test_drawn_jumps(motion):
    assert fly_drawn(motion, SHORT) == []


@pytest.mark.slow
@pytest.mark.parametrize("motion", MOTIONS)
def test_two_hundred_drawn_jumps(motion):
    assert fly_drawn(motion, LONG) == []


@pytest.mark.slow
@pytest.mark.parametrize(("count", "seconds"), [(25, WITHOUT_IT), (8, UNTIL_IT_IS_BACK)])
@pytest.mark.parametrize("motion", ["static", "car", "street"])
def test_long_flights_after_drawn_jumps(motion, count, seconds):
    assert fly_drawn(motion, count, seconds, seed=8) == []


@pytest.mark.parametrize("motion", MOTIONS)
def test_without_a_jump_every_epoch_is_fixed(motion):
    outcome = fly_jump(Jump(motion, CONVERGED + 10, ()))
    assert outcome.fixed == outcome.epochs
    assert outcome.largest < LARGEST


@pytest.mark.parametrize("motion", MOTIONS)
def test_the_jump_of_the_car(motion):
    """129 mm on all carriers of the first satellite: it goes, the others stay fixed."""
    rover = world(motion).epochs[0][1]
    outcome = fly_jump(Jump(motion, CONVERGED + 5, ((0, int(rover.prn[0]), 0.129),)))
    assert outcome.largest < LARGEST
    if motion != "street":
        assert outcome.fixed == outcome.epochs


def test_nothing_is_fixed_while_all_satellites_are_suspect():
    """Two of seven satellites in a street: any two of them would explain the changes."""
    outcome = fly_jump(Jump("street", CONVERGED + 3, ((0, 28, 0.195), (0, 26, 0.149))))
    assert outcome.largest < LARGEST
    assert outcome.integers == 0


def test_a_satellite_that_is_back_has_no_integers(monkeypatch):
    """0.26 m is 1.37 cycles of L1, and so near to one cycle of L2 that it would be taken for it."""
    monkeypatch.setattr(phase_jumps, "_EPOCHS_OUT", 5)
    world.cache_clear()
    rover = world("car").epochs[0][1]
    outcome = fly_jump(Jump("car", CONVERGED + 5, ((0, int(rover.prn[0]), 0.26),)))
    assert outcome.integers == len(rover) - 2
    world.cache_clear()


def changes(values: dict[int, float], directions: np.ndarray, clock: float = 0.0) -> PhaseChanges:
    keys = tuple(SignalKey(0, prn, 1, ord("C")) for prn in values)
    return PhaseChanges(
        keys=keys,
        residual=np.array(list(values.values())),
        variance=np.full(len(keys), 1e-6),
        direction=directions,
        clock_rate=np.linspace(1.0 - 2e-6, 1.0 + 2e-6, len(keys)),
        clock=clock,
    )


@pytest.fixture()
def directions() -> np.ndarray:
    random = np.random.default_rng(3).standard_normal((9, 3))
    return random / np.linalg.norm(random, axis=1, keepdims=True)


def searched(after: dict[int, float], directions: np.ndarray, clock: float = 0.0):
    detector = PhaseJumpDetector(is_static=False)
    before = dict.fromkeys(after, 0.0)
    detector.record(changes(before, directions), np.zeros(len(after)), np.ones(len(after), bool))
    return detector, detector.search(changes(after, directions, clock), 1.0)


def test_motion_and_clock_are_no_jump(directions):
    motion = -directions @ (3.0, -2.0, 1.0) + 5e4
    _, found = searched(dict(enumerate(motion.tolist(), 1)), directions)
    assert not found.satellites and not found.is_unexplained


def test_a_clock_that_jumps_is_no_jump_of_a_phase(directions):
    """By 1 ms: the ranges at another time, at rates of up to 600 m/s."""
    rate = np.linspace(-600.0, 600.0, 9)
    _, found = searched(dict(enumerate((1e-3 * rate).tolist(), 1)), directions, 1e-3)
    assert not found.satellites and not found.is_unexplained


@pytest.mark.parametrize("jumped", [{4: 0.1}, {2: -0.5, 7: 1.3}])
def test_satellites_are_found_and_stay_out(directions, jumped):
    after = {prn: jumped.get(prn, 0.0) for prn in range(1, 10)}
    detector, found = searched(after, directions)
    assert found.satellites == {(0, prn) for prn in jumped}
    assert detector.excluded((0, prn) for prn in after) == found.satellites


def test_three_satellites_are_unexplained(directions):
    _, found = searched(
        {prn: 0.4 * prn**2 * (prn in (2, 5, 8)) for prn in range(1, 10)}, directions
    )
    assert found.is_unexplained and not found.satellites
