"""Observation messages whose bytes are random, for tests of columns."""

import array

import numpy as np
from std_msgs.msg import Header

from vtff_gnss.observations import OBSERVATION_COLUMNS
from vtff_msgs.msg import GnssObservations


def random_observations(count, frame, generator):
    """Return observations whose bytes are random, NaN and infinity among them."""
    columns = {
        name: array.array(np.dtype(kind).char, generator.bytes(count * np.dtype(kind).itemsize))
        for name, kind in OBSERVATION_COLUMNS.items()
    }
    observations = GnssObservations(
        header=Header(frame_id=frame),
        gps_week=int(generator.integers(0, 3000)),
        gps_time_of_week=float(generator.uniform(0.0, 604800.0)),
        time_status=160,
        receiver_status=int(generator.integers(0, 2**32)),
        **columns,
    )
    observations.header.stamp.sec = int(generator.integers(0, 2**31))
    observations.header.stamp.nanosec = int(generator.integers(0, 10**9))
    return observations
