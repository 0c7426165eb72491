"""Compressed range logs against NovAtel's own decompression."""

from __future__ import annotations

import novatel_edie
import numpy as np
import pytest
from gnss_test_support import edie_range_vectors, events_of, oem_file
from novatel_edie import oem

from vtff_dynamics.time.timescales import GpsTime
from vtff_gnss import constants as c
from vtff_gnss.novatel import ReceiverLogStream, read_log
from vtff_gnss.novatel.range.lock_time import LockTimeTracker
from vtff_gnss.novatel.range.range_logs import RANGE_RECORD, decode_range
from vtff_gnss.novatel.range.signal_records import epoch_from_records
from vtff_gnss.observations import ObservationEpoch

EXACT_COLUMNS = ("system", "prn", "band", "attribute", "glonass_channel")
# RANGEA prints PSR, Doppler and the sigmas with 3 decimals, ADR with 6, C/N0 with 1.
PRINTED = {
    "pseudorange": 0.000501,
    "carrier_phase_cycles": 0.00000051,
    "doppler_hz": 0.00051,
    "cn0_dbhz": 0.05001,
    "pseudorange_sigma": 0.00051,
    "carrier_phase_sigma_cycles": 0.00051,
}


def assert_equal_to_printing(ours: ObservationEpoch, twin: ObservationEpoch, **wider: float):
    assert ours.time == twin.time
    for name in EXACT_COLUMNS:
        assert (getattr(ours, name) == getattr(twin, name)).all(), name
    for name, tolerance in (PRINTED | wider).items():
        mine, theirs = (np.asarray(getattr(e, name), dtype=np.float64) for e in (ours, twin))
        np.testing.assert_allclose(mine, theirs, rtol=1e-7 if "sigma" in name else 0.0,
                                   atol=tolerance, err_msg=name)  # fmt: skip


def vector_lines() -> list[bytes]:
    return edie_range_vectors().removesuffix(b"\r\n").split(b"\r\n")


def printed_epoch(line: bytes) -> ObservationEpoch:
    """Read RANGEA in the test itself: the RANGECMP5 twin has a wrong CRC."""
    head, body = line.split(b";")
    values = body.split(b"*")[0].split(b",")
    count = int(values[0])
    records = np.zeros(count, RANGE_RECORD)
    for index in range(count):
        fields = values[1 + 10 * index : 11 + 10 * index]
        records[index] = (
            *(int(v) for v in fields[:2]),
            *(float(v) for v in fields[2:9]),
            int(fields[9], 16),
        )
    header = head.split(b",")
    time = GpsTime.from_week_tow(int(header[5]), float(header[6]))
    payload = count.to_bytes(4, "little") + records.tobytes()
    return epoch_from_records(decode_range(payload), time, 180, 0, "RANGE", LockTimeTracker())[0]


PAIRS = {
    "RANGECMP": [(0,), (2,), (4,)],
    "RANGECMP2": [(6,), (8,), (10,)],
    # A differential log is preceded by the reference log of its second.
    "RANGECMP4": [(12,), (14,), (16,), (14, 18), (20,), (20, 22), (24,), (24, 26)],
    "RANGECMP5": [(28,)],
}


@pytest.mark.parametrize("log_name", PAIRS)
def test_vectors_equal_their_range_twins(log_name):
    lines = vector_lines()
    for indices in PAIRS[log_name]:
        ours = events_of(b"".join(lines[index] + b"\r\n" for index in indices))[-1]
        twin = printed_epoch(lines[indices[-1] + 1])
        assert ours.log_name == log_name, indices
        assert len(ours) > 20
        # The twins print the documented sigmas of the phase cut off, not rounded, to 3 decimals,
        # and C/N0 of RANGECMP4 and 5 comes in steps of 0.05 dB.
        assert_equal_to_printing(ours, twin, carrier_phase_sigma_cycles=0.001, cn0_dbhz=0.0501)
        lost = np.uint16(c.FLAG_LOCK_LOST)
        assert (ours.flags & ~lost == twin.flags & ~lost).all(), indices


def edie_records(lines: list[bytes]) -> np.ndarray:
    """Decode with a fresh decompressor of NovAtel; records of the last line."""
    novatel_edie.disable_internal_logging()
    converter, parser = oem.Parser(), oem.Parser()
    converter.decompress_range_cmp = False
    for line in lines:
        converter.write(line + b"\r\n")
        # Binary, because values decompressed from ASCII are rounded as RANGEA prints them.
        parser.write(next(iter(converter)).to_binary().message)
    content = list(parser)[-1].to_binary().message
    return np.frombuffer(content, RANGE_RECORD, offset=32, count=(len(content) - 36) // 44)


@pytest.mark.parametrize("log_name", PAIRS)
def test_vectors_equal_novatel_decompression(log_name):
    for indices in PAIRS[log_name]:
        lines = [vector_lines()[index] for index in indices]
        ours = events_of(b"\r\n".join([*lines, b""]))[-1]
        theirs = edie_records(lines)
        theirs = theirs[theirs["prn"] > 0]  # GLONASS satellites of unknown slot
        np.testing.assert_allclose(
            ours.pseudorange, theirs["pseudorange"], rtol=0, atol=1e-7, err_msg=str(indices)
        )
        np.testing.assert_allclose(
            ours.carrier_phase_cycles, -theirs["accumulated_doppler_cycles"], rtol=0, atol=1e-6
        )
        np.testing.assert_allclose(ours.doppler_hz, theirs["doppler_hz"], rtol=1e-6, atol=1e-4)
        np.testing.assert_allclose(ours.cn0_dbhz, theirs["cn0_dbhz"], rtol=1e-6)


def test_rangecmp4_without_its_reference_is_dropped_and_counted():
    lines = vector_lines()
    reference_other, difference = lines[16], lines[18]
    stream = ReceiverLogStream()
    stream.feed(reference_other + b"\r\n")
    (epoch,) = stream.feed(difference + b"\r\n")
    assert len(epoch) == 0
    assert stream.counters.signals_without_reference == 22


def test_rangecmp4_reference_of_another_second_is_not_used():
    lines = vector_lines()
    stream = ReceiverLogStream()
    stream.feed(lines[20] + b"\r\n")
    (epoch,) = stream.feed(lines[26] + b"\r\n")
    assert len(epoch) == 0 and stream.counters.signals_without_reference > 0


def test_rangecmp_equals_novatel_conversion_of_the_whole_file():
    ours, twins = (
        [e for e in read_log(oem_file(name)) if isinstance(e, ObservationEpoch)]
        for name in ("gavlab_test2_rcvr1.dat", "gavlab_test2_rcvr1_decompressed.ASC")
    )
    assert len(ours) == len(twins) == 436
    for epoch, twin in zip(ours, twins, strict=True):
        assert_equal_to_printing(epoch, twin)
        np.testing.assert_allclose(epoch.lock_time, twin.lock_time, rtol=1e-6, atol=0.00051)
        assert (epoch.flags == twin.flags).all()


def test_glonass_channel_is_number_less_7():
    """The ratio of phase to pseudorange of real logs is the carrier frequency."""
    checked = 0
    for line in vector_lines()[1::2]:
        epoch = printed_epoch(line)
        for band, base, step in ((1, 1602.0e6, 562.5e3), (2, 1246.0e6, 437.5e3)):
            chosen = (epoch.system == c.SYSTEM_GLONASS) & (epoch.band == band)
            ratio = epoch.carrier_phase_cycles[chosen] / epoch.pseudorange[chosen]
            channel = (ratio * 299792458.0 - base) / step
            assert np.abs(channel - epoch.glonass_channel[chosen]).max(initial=0.0) < 0.05
            checked += int(chosen.sum())
    assert checked > 100
