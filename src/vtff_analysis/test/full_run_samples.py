"""A made-up run with every kind of topic that reports, comparisons and exports know."""

import math

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import AccelStamped
from rclpy.serialization import serialize_message
from rosgraph_msgs.msg import Clock

from vtff_bag.file.writer import BagWriter
from vtff_dynamics.time.timescales import GpsTime
from vtff_gnss.orbits.ephemeris_selection import EphemerisStore
from vtff_gnss.orbits.line_of_sight import lines_of_sight
from vtff_gnss.orbits.nominal_constellation import nominal_gps_constellation
from vtff_msgs.msg import (
    GnssFix,
    GnssObservations,
    IrregularityBoundary,
    OrbitState,
    RelativeState,
    Scintillation,
    SimulatorStatus,
    SlantTec,
    StepDone,
)
from vtff_node.conversions.gnss import ephemeris_to_message
from vtff_node.stamps import to_stamp

START = 1_458_522_000 * 10**9
SECOND = 10**9
DEPUTY = "deputy"
#: On the equator 500 km up, m; the motion is that of a circular orbit seen from the Earth.
ORBIT_RADIUS = 6_878_137.0
RATE_INERTIAL = 1.1068e-3  # rad/s
EARTH_RATE = 7.2921151467e-5  # rad/s


class BagOfMessages:
    """Writes messages by topic, stamped with ns since 1970."""

    def __init__(self, directory, custom=None):
        self.writer = BagWriter(directory, custom, steady_clock=lambda: 0.0)
        self._topics = {}

    def add(self, topic, time, message):
        if topic not in self._topics:
            package = type(message).__module__.partition(".")[0]
            name = f"{package}/msg/{type(message).__name__}"
            self._topics[topic] = self.writer.add_topic(topic, name)
        if hasattr(message, "header"):
            message.header.stamp = to_stamp(time)
        else:
            message.clock = to_stamp(time)
        self.writer.write(self._topics[topic], serialize_message(message), time)


def orbit(seconds, lead=0.0):
    """Position and velocity in GCRF of the made-up orbit, m and m/s."""
    angle = RATE_INERTIAL * seconds + lead
    position = ORBIT_RADIUS * np.array([np.cos(angle), np.sin(angle), 0.0])
    speed = ORBIT_RADIUS * RATE_INERTIAL
    return position, speed * np.array([-np.sin(angle), np.cos(angle), 0.0])


def earth_fixed(seconds):
    """Position and velocity as a receiver would tell them, m and m/s; Greenwich along x at 0."""
    rate = RATE_INERTIAL - EARTH_RATE
    angle = rate * seconds
    position = ORBIT_RADIUS * np.array([np.cos(angle), np.sin(angle), 0.0])
    return position, ORBIT_RADIUS * rate * np.array([-np.sin(angle), np.cos(angle), 0.0])


def write_full_run(directory, seconds=200, seed=1, bias=0.0, custom=None):
    """Write the run; `bias` (m) shifts the navigated in-track position."""
    generator = np.random.default_rng(seed)
    bag = BagOfMessages(directory, custom)
    start = GpsTime.from_unix_nanoseconds(START)
    ephemerides = nominal_gps_constellation(start, start + float(seconds))
    for ephemeris in ephemerides:
        message = ephemeris_to_message(ephemeris)
        bag.add("/chief/gnss/ephemeris", START, message)
    table = EphemerisStore(ephemerides).table(start)
    for second in range(seconds + 1):
        time = START + second * SECOND
        bag.add("/clock", time, Clock())
        _add_formation(bag, second, time, generator, bias)
        _add_receiver(bag, second, time, table, start, generator)
        _add_ionosphere(bag, second, time, generator)
        _add_health(bag, second, time)
        for node, scale in (("/sdre_controller", 1e-4), ("/relative_ekf", 2e-3)):
            took = float(scale * generator.lognormal(0.0, 0.3))
            bag.add("/sim/step_done", time, StepDone(node=node, compute_time=took))
        state = SimulatorStatus.STATE_ENDED if second == seconds else SimulatorStatus.STATE_RUNNING
        status = SimulatorStatus(
            scenario="reference", state=state, time_into_run=float(second), real_time_factor=321.0
        )
        bag.add("/sim/status", time, status)
    for width, sigma in ((2400.0, 300.0), (400.0, 300.0), (math.nan, math.nan)):
        edge = IrregularityBoundary(entry=True, spacecraft=DEPUTY, prn=5, latitude_deg=-11.5)
        edge.width, edge.width_sigma = width, sigma
        bag.add("/deputy/iono/irregularity_boundaries", START + 50 * SECOND, edge)
    bag.writer.close()
    return directory


def _add_formation(bag, second, time, generator, bias):
    for craft, lead in (("chief", 0.0), (DEPUTY, 1.5e-5)):
        message = OrbitState(child_frame_id=craft)
        message.header.frame_id = "gcrf"
        message.position, message.velocity = orbit(float(second), lead)
        bag.add(f"/{craft}/truth/orbit", time, message)
    in_track = 100.0 + 900.0 * np.exp(-second / 8.0)
    truth = RelativeState(child_frame_id=DEPUTY, solution=RelativeState.SOLUTION_TRUTH)
    truth.position = np.array([0.0, in_track, 0.0])
    bag.add("/deputy/relative_state_truth", time, truth)
    if second > 5:
        fixed = second > 60
        sigma = np.array([0.02, 0.01, 0.01] if fixed else [0.6, 0.3, 0.3])
        estimate = RelativeState(
            child_frame_id=DEPUTY,
            solution=RelativeState.SOLUTION_FIXED if fixed else RelativeState.SOLUTION_FLOAT,
            satellites_used=9,
            ambiguities_fixed=14 if fixed else 0,
            ratio=5.0,
            innovation_rms=float(generator.normal(1.0, 0.1)),
        )
        estimate.position = truth.position + sigma * generator.normal(size=3) + [0.0, bias, 0.0]
        covariance = np.zeros((6, 6))
        covariance[range(3), range(3)] = sigma**2
        covariance[range(3, 6), range(3, 6)] = 1e-6
        estimate.covariance = covariance.ravel()
        bag.add("/deputy/relative_state", time, estimate)
    command = AccelStamped()
    command.accel.linear.y = -0.5 if second < 10 else 0.0
    bag.add(f"/{DEPUTY}/control/thrust_command", time, command)
    bag.add(f"/{DEPUTY}/propulsion/thrust_applied", time + SECOND, command)


def _add_receiver(bag, second, time, table, start, generator):
    position, velocity = earth_fixed(float(second))
    sight = lines_of_sight(table, start + float(second), 0.0, position, velocity)
    visible = np.flatnonzero(sight.elevation > 0.1)
    count = len(visible)
    epoch = GpsTime.from_unix_nanoseconds(time)
    message = GnssObservations(gps_week=epoch.week, gps_time_of_week=epoch.time_of_week)
    message.system = table.system[visible]
    message.prn = table.prn[visible]
    message.band = np.ones(count, np.uint8)
    message.attribute = np.full(count, 67, np.uint8)
    message.glonass_channel = np.zeros(count, np.int8)
    message.pseudorange = sight.range[visible]
    message.carrier_phase_cycles = sight.range[visible] / 0.19029367279836487
    message.doppler_hz = (-sight.range_rate[visible] / 0.19029367279836487).astype(np.float32)
    message.cn0_dbhz = (38.0 + 10.0 * np.sin(sight.elevation[visible])).astype(np.float32)
    message.cn0_dbhz = np.asarray(message.cn0_dbhz) + generator.normal(0.0, 0.3, count).astype(
        np.float32
    )
    message.pseudorange_sigma = np.full(count, 0.3, np.float32)
    message.carrier_phase_sigma_cycles = np.full(count, 0.005, np.float32)
    message.lock_time = np.full(count, float(second), np.float32)
    message.flags = np.full(count, 7, np.uint16)
    bag.add("/chief/gnss/epoch", time, message)
    fix = GnssFix(
        status=GnssFix.STATUS_SINGLE, gps_week=epoch.week, gps_time_of_week=epoch.time_of_week
    )
    fix.position, fix.velocity = position, velocity
    fix.satellites_used = count
    bag.add("/chief/gnss/fix", time, fix)


def _add_ionosphere(bag, second, time, generator):
    prn = np.array([3, 7, 9], np.uint8)
    tec = SlantTec(system=np.zeros(3, np.uint8), prn=prn)
    tec.stec_tecu = 20.0 + prn + 0.05 * second
    tec.stec_sigma_tecu = np.full(3, 0.5, np.float32)
    tec.vtec_tecu = (12.0 + 0.02 * second + np.zeros(3)).astype(np.float32)
    tec.elevation = np.full(3, 0.7, np.float32)
    tec.azimuth = np.array([0.1, 2.0, 4.0], np.float32)
    bag.add("/deputy/iono/slant_tec", time, tec)
    if second % 60 == 0 and second:
        indices = Scintillation(window=60.0, system=np.zeros(3, np.uint8), prn=prn)
        indices.band = np.ones(3, np.uint8)
        indices.s4 = np.abs(generator.normal(0.3, 0.1, 3)).astype(np.float32)
        indices.sigma_phi = np.abs(generator.normal(0.2, 0.05, 3)).astype(np.float32)
        bag.add("/deputy/iono/scintillation", time, indices)


def _add_health(bag, second, time):
    if second % 10:
        return
    late = second == 30
    status = DiagnosticStatus(
        name="thruster: bus",
        level=DiagnosticStatus.WARN if late else DiagnosticStatus.OK,
        message="no acknowledgement for 0.5 s" if late else "thrusting",
        hardware_id=DEPUTY,
        values=[KeyValue(key="frames", value=str(second)), KeyValue(key="errors", value="0")],
    )
    bag.add("/diagnostics", time, DiagnosticArray(status=[status]))
