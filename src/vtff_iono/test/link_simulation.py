"""Observations of simulated satellites with known content, in the columns of vtff_gnss."""

from __future__ import annotations

import numpy as np

from vtff_gnss import constants as c
from vtff_gnss.signals import carrier_frequency_hz

LIGHT = 299_792_458.0
START = 1_388_000_000_000_000_000
ALL_VALID = c.FLAG_CODE_VALID | c.FLAG_PHASE_VALID | c.FLAG_PARITY_KNOWN


def observations(
    time,
    content_tecu,
    signals=((1, "C"), (2, "W")),
    code_sigma=0.3,
    phase_sigma=0.001,
    bias_second=0.0,
    slips=None,
    seed=0,
    system=c.SYSTEM_GPS,
):
    """Return times (ns) and columns of m satellites at n epochs, ordered by time.

    `time` (n,) s, `content_tecu` (n, m); `bias_second` (m,) m is added to the second and further
    codes; `slips` maps (satellite, signal) to (epoch, cycles). Ranges are 2e7 m and grow.
    """
    generator = np.random.default_rng(seed)
    epochs, satellites = content_tecu.shape
    nanoseconds = START + np.round(np.asarray(time) * 1e9).astype(np.int64)
    geometric = 2.1e7 + 700.0 * np.asarray(time)[:, None] + 1e5 * np.arange(satellites)
    parts = []
    for index, (band, attribute) in enumerate(signals):
        frequency = float(carrier_frequency_hz([system], [band])[0])
        delay = 40.308193e16 / frequency**2 * content_tecu
        code = geometric + delay + code_sigma * generator.standard_normal((epochs, satellites))
        if index:
            code = code + bias_second
        phase = geometric - delay + phase_sigma * generator.standard_normal((epochs, satellites))
        cycles = phase * frequency / LIGHT - 1000.0 * (index + 1)
        for satellite in range(satellites):
            if slips and (satellite, index) in slips:
                epoch, jump = slips[satellite, index]
                cycles[epoch:, satellite] += jump
        parts.append((band, ord(attribute), code, cycles))
    count = len(parts)
    shape = (epochs, satellites, count)

    def filled(values, kind):
        return np.broadcast_to(values, shape).astype(kind).ravel()

    columns = {
        "system": filled(system, np.uint8),
        "prn": filled(np.arange(1, satellites + 1)[:, None], np.uint8),
        "band": filled([part[0] for part in parts], np.uint8),
        "attribute": filled([part[1] for part in parts], np.uint8),
        "glonass_channel": filled(0, np.int8),
        "pseudorange": np.stack([part[2] for part in parts], axis=-1).ravel(),
        "carrier_phase_cycles": np.stack([part[3] for part in parts], axis=-1).ravel(),
        "cn0_dbhz": filled(45.0, np.float32),
        "lock_time": filled(1000.0 + np.asarray(time)[:, None, None], np.float32),
        "flags": filled(ALL_VALID, np.uint16),
    }
    return filled(nanoseconds[:, None, None], np.int64), columns


def pieces(time, columns, elevation, epochs):
    """Cut observations into calls of a number of whole epochs."""
    edges = np.flatnonzero(np.diff(time, prepend=time[0] - 1))[::epochs].tolist() + [len(time)]
    for start, end in zip(edges[:-1], edges[1:], strict=True):
        part = {name: column[start:end] for name, column in columns.items()}
        yield time[start:end], part, np.asarray(elevation)[start:end]
