"""The high-pass filter is that of scipy, to the last bit."""

import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from iono_test_support import examples
from scipy import signal

from vtff_iono.scintillation.high_pass import HIGH_PASS_ORDER, filter_high_pass


def by_scipy(values: np.ndarray, rate: float, cutoff: float) -> np.ndarray:
    sections = signal.butter(HIGH_PASS_ORDER, cutoff, "highpass", fs=rate, output="sos")
    return signal.sosfiltfilt(sections, values, axis=-1)


@given(
    st.floats(0.01, 200.0),
    st.floats(1e-4, 0.499),
    st.integers(13, 80),
    st.integers(0, 2**32 - 1),
)
@examples(100)
def test_filtered_values_are_those_of_scipy(rate, share, count, seed):
    values = np.random.default_rng(seed).normal(size=(3, count)).cumsum(axis=1)
    expected = by_scipy(values, rate, share * rate)
    found = filter_high_pass(values, rate, share * rate)
    assert found.tobytes() == expected.tobytes()
    # Sums depend on the order in memory, in the last bit.
    assert found.std(axis=-1).tobytes() == expected.std(axis=-1).tobytes()
    one = filter_high_pass(values[1], rate, share * rate)
    assert one.tobytes() == expected[1].tobytes()


def test_too_few_values_are_refused():
    with pytest.raises(ValueError, match="12 samples; the filter needs 13"):
        filter_high_pass(np.zeros(12), 20.0, 1.0)
    with pytest.raises(ValueError):
        by_scipy(np.zeros(12), 20.0, 1.0)


def test_scintillation_does_without_the_signal_package():
    program = (
        "import sys\n"
        "import numpy as np\n"
        "from vtff_iono.scintillation.indices import phase_deviation\n"
        "phase_deviation(np.random.default_rng(1).normal(size=(2, 100)), 20.0, 1.0)\n"
        "assert 'scipy.signal' not in sys.modules\n"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
