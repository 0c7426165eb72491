"""What is learnt of noise does not depend on how much it has grown towards the horizon."""

from __future__ import annotations

import numpy as np

from vtff_dynamics.time.timescales import GpsTime
from vtff_gnss.signals import SignalKey
from vtff_nav.relative.common.measurements import SingleDifferences
from vtff_nav.relative.noise.monitor import EpochResiduals, NoiseMonitor, NoisePrior

COUNT, SECONDS = 12, 90
KEYS = [SignalKey(0, prn, 1, ord("C")) for prn in range(1, COUNT + 1)]


def differences(code, phase, growth) -> SingleDifferences:
    plain = SingleDifferences(
        keys=KEYS,
        satellite=np.arange(COUNT),
        wavelength=np.full(COUNT, 0.19),
        frequency_hz=np.full(COUNT, 1575.42e6),
        code=code * growth,
        phase=phase * growth,
        code_variance=np.full(COUNT, 0.09),
        phase_variance=np.full(COUNT, 4e-6),
        is_parity_known=np.ones(COUNT, dtype=bool),
        half_cycles=np.zeros(COUNT, dtype=np.int64),
        is_lock_lost=np.zeros(COUNT, dtype=bool),
        lock_time=np.zeros((2, COUNT)),
        noise_growth=np.ones(COUNT),
    )
    return plain.grown(growth)


def learnt(growth: np.ndarray) -> tuple[NoiseMonitor, SingleDifferences]:
    """Return a monitor after noise of three times the stated, with a slow part, and its weights."""
    generator = np.random.default_rng(5)
    design = generator.standard_normal((COUNT, 4))
    monitor = NoiseMonitor(NoisePrior(0.003, 0.3, 100.0), 3600.0)
    slow = 0.004 * generator.standard_normal(COUNT)
    for second in range(SECONDS):
        code = 0.9 * generator.standard_normal(COUNT)
        phase = slow + 0.006 * generator.standard_normal(COUNT)
        measured = differences(code, phase, growth)
        time = GpsTime(second * 10**9)
        weighed = monitor.weigh(time, 1.0, measured)
        monitor.learn(
            time,
            1.0,
            EpochResiduals(
                measured=measured,
                predicted=np.zeros(COUNT),
                integer_cycles=np.zeros(COUNT),
                is_phase_continued=np.ones(COUNT, dtype=bool),
                common=design * growth[:, None],
                plasma=np.zeros((COUNT, 0)),
                is_code_sample=np.ones(COUNT, dtype=bool),
                is_phase_sample=np.ones(COUNT, dtype=bool),
            ),
        )
    return monitor, weighed


def test_growth_is_taken_off_before_noise_is_learnt_and_put_on_its_weights():
    growth = np.linspace(1.0, 4.0, COUNT)
    plain, weighed = learnt(np.ones(COUNT))
    grown, weighed_grown = learnt(growth)
    assert plain.phase.white_factor > 4.0 and plain.code.white_factor > 4.0
    for kind in ("phase", "code"):
        expected, found = getattr(plain, kind), getattr(grown, kind)
        np.testing.assert_allclose(found.white_factor, expected.white_factor)
        np.testing.assert_allclose(found.slow.sigma, expected.slow.sigma)
    for column in ("phase_variance", "code_variance"):
        np.testing.assert_allclose(
            getattr(weighed_grown, column), growth**2 * getattr(weighed, column)
        )
