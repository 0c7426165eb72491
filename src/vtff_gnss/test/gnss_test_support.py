"""Shared data and frame builders of the vtff_gnss tests."""

from __future__ import annotations

import gzip
import pathlib
import struct
import zlib

import numpy as np
from hypothesis import settings
from shared_data import require_shared

from vtff_gnss.novatel import ReceiverLogStream
from vtff_gnss.novatel.range.range_logs import RANGE_RECORD

L1CA = 0x08109C04
L2P_CODELESS = 0x01303C0B
L2C = 0x0230DC0B


def examples(count: int) -> settings:
    """Return settings of a property test: the same examples in every run, nothing stored."""
    return settings(max_examples=count)


def oem_file(name: str) -> pathlib.Path:
    """Return a real receiver log, or skip the test."""
    return require_shared(f"data/oem/{name}")


def edie_range_vectors() -> bytes:
    """Return ASCII logs of NovAtel's test vectors: compressed ranges, each before its RANGEA."""
    vectors = pathlib.Path(__file__).parent / "novatel/range/vectors/edie_range.asc.gz"
    return gzip.decompress(vectors.read_bytes())


def crc32(content: bytes) -> int:
    """Return NovAtel's CRC-32, written independently of the library: bit by bit for short input."""
    if len(content) > 4096:
        return zlib.crc32(content, 0xFFFFFFFF) ^ 0xFFFFFFFF
    crc = 0
    for byte in content:
        crc ^= byte
        for _ in range(8):
            crc = crc >> 1 ^ (0xEDB88320 if crc & 1 else 0)
    return crc


def binary_frame(
    message_id: int,
    payload: bytes,
    milliseconds: int = 345_600_000,
    week: int = 2200,
    time_status: int = 180,
    message_type: int = 0,
) -> bytes:
    """Build a long binary frame."""
    head = struct.pack("<BBBBHBBHHBBHIIHH", 0xAA, 0x44, 0x12, 28, message_id, message_type, 0x20,
                       len(payload), 0, 0, time_status, week, milliseconds, 0, 0, 0)  # fmt: skip
    return head + payload + struct.pack("<I", crc32(head + payload))


def range_records(count: int, seed: int = 0, lock_time: float = 10.0) -> np.ndarray:
    """Return plausible GPS RANGE records of `count` signals."""
    generator = np.random.default_rng(seed)
    records = np.zeros(count, RANGE_RECORD)
    records["prn"] = np.arange(count) // 3 + 1
    records["tracking_status"] = np.resize([L1CA, L2P_CODELESS, L2C], count)
    records["pseudorange"] = generator.uniform(2.0e7, 2.6e7, count)
    records["pseudorange_sigma"] = 0.1
    records["accumulated_doppler_cycles"] = -generator.uniform(1.0e8, 1.4e8, count)
    records["accumulated_doppler_sigma_cycles"] = 0.01
    records["doppler_hz"] = generator.uniform(-4e3, 4e3, count)
    records["cn0_dbhz"] = generator.uniform(30.0, 50.0, count)
    records["lock_time"] = lock_time
    return records


def range_frame(records: np.ndarray, milliseconds: int = 345_600_000) -> bytes:
    """Build a RANGEB log."""
    return binary_frame(43, struct.pack("<I", len(records)) + records.tobytes(), milliseconds)


def events_of(content: bytes, chunk_lengths: list[int] | None = None, **options) -> list:
    """Return all events of a byte string, fed whole or in chunks of the given lengths in turn."""
    stream = ReceiverLogStream(**options)
    if not chunk_lengths:
        return stream.feed(content) + stream.close()
    events, position, index = [], 0, 0
    while position < len(content):
        length = chunk_lengths[index % len(chunk_lengths)]
        events += stream.feed(content[position : position + length])
        position += length
        index += 1
    return events + stream.close()
