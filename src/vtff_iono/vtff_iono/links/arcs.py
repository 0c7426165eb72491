"""Continuous arcs of carrier phase: where a cycle slip is possible, an arc ends.

An arc is broken, never repaired: in scintillation a guess of the lost cycles is a wrong electron
content for the rest of the arc. Tests, in this order; any of them breaks all links of the
satellite, because the frequencies of a satellite share signals:

1. the receiver says so: lock lost, half a cycle changed, a lock time shorter than the time since
   the last sample;
2. a gap longer than the settings allow;
3. geometry-free: the phase content jumps off its prediction (value and rate of a filter);
4. Melbourne-Wuebbena: the wide lane, averaged over a short time, leaves its mean;
5. closure: two pairs of the satellite that share the first signal see one ionosphere, so the
   difference of their contents hardly changes, whatever the ionosphere does.

The limits of test 3 grow with the interval of the samples: 0.15 TECU at 20 Hz finds every slip of
integer cycles that changes the content by 0.24 TECU or more, while a wall of a plasma bubble
met at 7.5 km/s changes it by 0.08 TECU at most. At 30 s on the ground the ionosphere moves more
than the smallest slips, so the limit follows the scatter of the innovations up to a cap.

References
----------
Blewitt (1990), An automatic editing algorithm for GPS data, Geophys. Res. Lett. 17(3), 199-202
(tests 3 and 4; here both are recursive, for any sample rate).
"""

from __future__ import annotations

import enum
from dataclasses import astuple, dataclass

import numpy as np
import numpy.typing as npt

from vtff_dynamics.compiled import compiled
from vtff_iono.links.signal_pairs import PairRows

__all__ = ["ArcBreak", "ArcDetector", "ArcSettings", "Arcs"]


class ArcBreak(enum.IntEnum):
    """Why an arc began with a sample."""

    NONE = 0
    """The sample continues an arc, or belongs to none."""
    START = 1
    """First sample of the link, or the first after its phase was not valid."""
    GAP = 2
    LOCK = 3
    """The receiver lost lock or its lock time began anew."""
    HALF_CYCLE = 4
    GEOMETRY_FREE = 5
    WIDE_LANE = 6
    OTHER_LINK = 7
    """A test found a slip in another link of the satellite."""
    CLOSURE = 8


@dataclass(frozen=True)
class ArcSettings:
    """Limits of the tests.

    Parameters
    ----------
    gap_intervals : float
        A gap is more than this many sample intervals ...
    gap : float
        ... and longer than this, s.
    jump_tecu, jump_rate : float
        Smallest limit of the geometry-free test: TECU, plus TECU/s times the interval.
    cap_tecu, cap_rate : float
        Its largest limit.
    jump_sigmas : float
        Between the two, this many times the scatter of the innovations.
    wide_lane_cycles, wide_lane_sigmas : float
        Limit of the Melbourne-Wuebbena test: the larger of the two, cycles and standard deviations.
    wide_lane_average : float
        Time over which the wide lane is averaged for the test, s.
    closure_tecu, closure_sigmas : float
        Limit of the closure test: the larger of the two, TECU and standard deviations.
    closure_average : float
        Time over which its mean follows the slow changes of the hardware, s.
    """

    gap_intervals: float = 2.5
    gap: float = 1.5
    jump_tecu: float = 0.15
    jump_rate: float = 0.03
    cap_tecu: float = 0.18
    cap_rate: float = 0.25
    jump_sigmas: float = 5.5
    wide_lane_cycles: float = 0.6
    wide_lane_sigmas: float = 5.0
    wide_lane_average: float = 3.0
    closure_tecu: float = 0.15
    closure_sigmas: float = 5.5
    closure_average: float = 60.0


@dataclass(frozen=True, eq=False)
class Arcs:
    """Arcs of rows; all arrays have shape (n,).

    Parameters
    ----------
    number : ndarray of int64
        Number of the arc within its link, from 1; 0 where the phase cannot be used.
    break_reason : ndarray of int64
        `ArcBreak` of the first sample of an arc.
    """

    number: npt.NDArray[np.int64]
    break_reason: npt.NDArray[np.int64]


# Columns of the state of a link.
_ARC, _TIME, _VALUE, _RATE, _COUNT, _SCATTER, _HALF, _LOCK = range(8)
_WIDE_FAST, _WIDE_MEAN, _WIDE_SPREAD, _WIDE_COUNT = range(8, 12)
_CLOSURE_MEAN, _CLOSURE_SPREAD, _CLOSURE_COUNT = range(12, 15)
_STATE = 15
# Columns of the state of the detector: time of the last epoch and shortest interval of epochs.
_LAST_EPOCH, _NOMINAL = range(2)

# Gains of the filter that predicts the content: critically damped with a memory of some samples.
_GAIN_VALUE = 0.5
_GAIN_RATE = 0.2
_SETTLING_SAMPLES = 4
_WIDE_LANE_SETTLING = 20
_WIDE_LANE_MEMORY = 1800.0
_SCATTER_MEMORY = 30.0


class ArcDetector:
    """Divides the rows of links into arcs.

    Parameters
    ----------
    settings : ArcSettings
    """

    def __init__(self, settings: ArcSettings = ArcSettings()) -> None:  # noqa: B008 - frozen
        self._settings = np.array(astuple(settings))
        self._state = np.zeros((0, _STATE))
        self._broken = np.zeros(0, dtype=np.int64)
        self._epochs = np.zeros(2)

    def update(self, rows: PairRows) -> Arcs:
        """Return the arcs of rows, one or more whole epochs in order of time."""
        self._grow(rows)
        number, reason = _divide(
            rows.time,
            rows.link,
            rows.satellite,
            rows.row_first,
            rows.stec_phase_tecu,
            rows.wide_lane_cycles,
            rows.lock_time,
            rows.phase_valid,
            rows.code_valid,
            rows.lock_lost,
            rows.half_cycle,
            self._settings,
            self._state,
            self._broken,
            self._epochs,
        )
        return Arcs(number, reason)

    def _grow(self, rows: PairRows) -> None:
        if len(rows) == 0:
            return
        missing = int(rows.link.max()) + 1 - len(self._state)
        if missing > 0:
            self._state = np.concatenate((self._state, np.zeros((missing, _STATE))))
        missing = int(rows.satellite.max()) + 1 - len(self._broken)
        if missing > 0:
            self._broken = np.concatenate((self._broken, np.zeros(missing, dtype=np.int64)))


@compiled
def _geometry_free_limit(state, interval, settings):  # type: ignore[no-untyped-def]
    """Return how far a content may be from its prediction, TECU."""
    smallest = settings[2] + settings[3] * interval
    largest = settings[4] + settings[5] * interval
    return min(max(smallest, settings[6] * np.sqrt(state[_SCATTER])), max(largest, smallest))


@compiled
def _tested(  # type: ignore[no-untyped-def]
    state, interval, content, wide_lane, lock_time, has_code, lost, half, nominal, settings
):
    """Return the `ArcBreak` that a sample calls for; 0 = it continues the arc."""
    if state[_COUNT] == 0.0:
        return 1
    # Lock times are rounded to 1/32 s in compressed logs.
    if lost or lock_time < state[_LOCK] - 0.05 or lock_time < interval - 0.1:
        return 3
    if half != state[_HALF]:
        return 4
    if interval > settings[1] and interval > settings[0] * nominal:
        return 2
    jump = abs(content - state[_VALUE] - state[_RATE] * interval)
    limit = _geometry_free_limit(state, interval, settings)
    # Until the rate is known, only what no ionosphere does is a jump.
    if state[_COUNT] <= _SETTLING_SAMPLES:
        limit = settings[4] + settings[5] * interval
    # A slip that the wide lane shows is one; a jump of the content alone may be the ionosphere.
    if has_code and state[_WIDE_COUNT] >= 2.0:
        gain = min(1.0, interval / settings[9])
        fast = state[_WIDE_FAST] + gain * (wide_lane - state[_WIDE_FAST])
        spread = np.sqrt(state[_WIDE_SPREAD])
        if state[_WIDE_COUNT] < _WIDE_LANE_SETTLING:
            spread = max(spread, settings[7])
        if abs(fast - state[_WIDE_MEAN]) > max(settings[7], settings[8] * spread):
            return 6
    return 5 if jump > limit else 0


@compiled
def _continued(state, interval, content, wide_lane, has_code, settings):  # type: ignore[no-untyped-def]
    """Take a sample of the same arc into the state of its link."""
    count = state[_COUNT]
    innovation = content - state[_VALUE] - state[_RATE] * interval
    if count == 1.0:
        state[_RATE] = innovation / interval
        state[_VALUE] = content
    else:
        # The first gains are those of a straight line through all samples so far.
        gain_value = max(_GAIN_VALUE, 2.0 * (2.0 * count + 1.0) / ((count + 1.0) * (count + 2.0)))
        gain_rate = max(_GAIN_RATE, 6.0 / ((count + 1.0) * (count + 2.0)))
        state[_VALUE] += state[_RATE] * interval + gain_value * innovation
        state[_RATE] += gain_rate * innovation / interval
        if count >= _SETTLING_SAMPLES:
            part = max(1.0 / _SCATTER_MEMORY, 1.0 / (count - _SETTLING_SAMPLES + 1.0))
            state[_SCATTER] += part * (innovation * innovation - state[_SCATTER])
    state[_COUNT] = count + 1.0
    if has_code:
        _wide_lane_continued(state, interval, wide_lane, settings)


@compiled
def _wide_lane_continued(state, interval, wide_lane, settings):  # type: ignore[no-untyped-def]
    """Update short and long mean of the wide lane, and the spread of the short about the long."""
    count = state[_WIDE_COUNT]
    if count == 0.0:
        state[_WIDE_FAST] = state[_WIDE_MEAN] = wide_lane
        state[_WIDE_SPREAD] = 0.0
    else:
        gain = max(min(1.0, interval / settings[9]), 1.0 / (count + 1.0))
        state[_WIDE_FAST] += gain * (wide_lane - state[_WIDE_FAST])
        deviation = state[_WIDE_FAST] - state[_WIDE_MEAN]
        part = max(1.0 / (count + 1.0), min(1.0, interval / _WIDE_LANE_MEMORY))
        state[_WIDE_MEAN] += part * (wide_lane - state[_WIDE_MEAN])
        state[_WIDE_SPREAD] += part * (deviation * deviation - state[_WIDE_SPREAD])
    state[_WIDE_COUNT] = count + 1.0


@compiled
def _closes(state, interval, closure, settings):  # type: ignore[no-untyped-def]
    """Return whether a closure is near its mean, and take it into the mean if so."""
    count = state[_CLOSURE_COUNT]
    if count == 0.0:
        state[_CLOSURE_MEAN] = closure
        state[_CLOSURE_COUNT] = 1.0
        return True
    deviation = closure - state[_CLOSURE_MEAN]
    if abs(deviation) > max(settings[10], settings[11] * np.sqrt(state[_CLOSURE_SPREAD])):
        return False
    part = max(1.0 / (count + 1.0), min(1.0, interval / settings[12]))
    state[_CLOSURE_MEAN] += part * deviation
    state[_CLOSURE_SPREAD] += part * (deviation * deviation - state[_CLOSURE_SPREAD])
    state[_CLOSURE_COUNT] = count + 1.0
    return True


@compiled
def _divide(  # type: ignore[no-untyped-def]
    time,
    link,
    satellite,
    row_first,
    content,
    wide_lane,
    lock_time,
    phase_valid,
    code_valid,
    lock_lost,
    half_cycle,
    settings,
    states,
    broken,
    epochs,
):
    """Return number of the arc and reason of its beginning; `states` of the links are updated."""
    count = len(time)
    number = np.zeros(count, dtype=np.int64)
    reason = np.zeros(count, dtype=np.int64)
    start = 0
    while start < count:
        end = start
        since_last = 1e-9 * (time[start] - epochs[_LAST_EPOCH])
        if epochs[_LAST_EPOCH] > 0.0 and (epochs[_NOMINAL] == 0.0 or since_last < epochs[_NOMINAL]):
            epochs[_NOMINAL] = since_last
        epochs[_LAST_EPOCH] = time[start]
        while end < count and time[end] == time[start]:
            satellite_slips = False
            if link[end] >= 0 and phase_valid[end]:
                state = states[link[end]]
                interval = 1e-9 * (time[end] - state[_TIME])
                reason[end] = _tested(
                    state,
                    interval,
                    content[end],
                    wide_lane[end],
                    lock_time[end],
                    code_valid[end],
                    lock_lost[end],
                    half_cycle[end],
                    epochs[_NOMINAL],
                    settings,
                )
                reference = end - 1
                while reference >= start and row_first[reference] == row_first[end]:
                    reference -= 1
                reference += 1
                if reference < end and reason[end] == 0 and reason[reference] == 0:
                    if phase_valid[reference] and not _closes(
                        state, interval, content[end] - content[reference], settings
                    ):
                        reason[end] = 8
                satellite_slips = reason[end] >= 3
            if satellite_slips:
                broken[satellite[end]] = 1
            end += 1
        for row in range(start, end):
            if link[row] < 0:
                continue
            state = states[link[row]]
            if not phase_valid[row]:
                state[_COUNT] = 0.0
                continue
            if broken[satellite[row]] and reason[row] == 0:
                reason[row] = 7
            interval = 1e-9 * (time[row] - state[_TIME])
            if reason[row] != 0:
                arc = state[_ARC] + 1.0
                state[:] = 0.0
                state[_ARC] = arc
                state[_COUNT] = 1.0
                state[_VALUE] = content[row]
                state[_HALF] = half_cycle[row]
                if code_valid[row]:
                    _wide_lane_continued(state, 1.0, wide_lane[row], settings)
            else:
                _continued(state, interval, content[row], wide_lane[row], code_valid[row], settings)
            state[_TIME] = time[row]
            state[_LOCK] = lock_time[row]
            number[row] = int(state[_ARC])
        for row in range(start, end):
            broken[satellite[row]] = 0
        start = end
    return number, reason
