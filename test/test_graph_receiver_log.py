"""`vtff run receiver_log.yaml`: a bag holds what is in a real receiver log, and nothing else."""

from __future__ import annotations

import collections
import concurrent.futures
import dataclasses
import os
import random

import numpy as np
import pytest
from encoder_test_support import receiver_log
from graph_support import SYSTEMS, run_vtff
from shared_data import require_shared

from vtff_bag.file.reader import BagReader
from vtff_gnss import constants
from vtff_gnss.ephemeris import BroadcastEphemeris, GlonassEphemeris
from vtff_gnss.fix import Fix
from vtff_gnss.novatel import RawLog, read_log
from vtff_gnss.observations import ObservationEpoch
from vtff_node.conversions import gnss as conversions
from vtff_node.plain_yaml import format_yaml, parse_yaml
from vtff_node.stamps import to_nanoseconds

SYSTEM = "receiver_log.yaml"
SECOND = 1_000_000_000
UNIX_TIME_OF_GPS_EPOCH = 315_964_800
EPHEMERIS_FIELDS = [field.name for field in dataclasses.fields(BroadcastEphemeris)]
FIX_FIELDS = [field.name for field in dataclasses.fields(Fix)]

#: Epochs, epochs at whole seconds, ephemerides, fixes, logs; edie_ascii_vectors.asc holds most
#: epochs in two formats, and one whose RANGECMP4 lacks its reference.
LOGS = {
    "rtklib_oemv_200911218.gps": (46, 46, 9, 0, 317),
    "gavlab_test2_rcvr1.dat": (436, 436, 13, 448, 897),
    "gavlab_test2_rcvr2.dat": (429, 429, 13, 437, 879),
    "gavlab_test2_rcvr1_decompressed.ASC": (436, 436, 13, 448, 897),
    "gavlab_OnceEachAgain.GPS": (2, 2, 19, 1, 49),
    "gavlab_OnceEachAgain.ASC": (2, 2, 19, 1, 58),
    "gavlab_ParsingData.GPS": (0, 0, 0, 0, 265),
    "edie_ascii_vectors.asc": (18, 14, 0, 0, 50),
}
#: Real logs that only slow tests fly. Decoding them is tested in vtff_gnss always; what a bag can
#: lose is seen with the others: both formats, GLONASS, no epochs, two formats in one file. The
#: second of the pair is flown always by the tests of two receivers and of a damaged log.
SLOW_LOGS = (
    "gavlab_test2_rcvr2.dat",
    "gavlab_test2_rcvr1_decompressed.ASC",
    "gavlab_OnceEachAgain.GPS",
    "gavlab_OnceEachAgain.ASC",
)
SPEEDS = [pytest.param(False, id="short"), pytest.param(True, id="rest", marks=pytest.mark.slow)]
#: A log that the project's own encoders make: everywhere, and the same numbers.
OWN_SECONDS = 60
OWN_LOG = (60, 60, 3, 60, 305)
#: Files that the independent decoder reads, with its number of epochs.
RTKLIB_EPOCHS = {
    "rtklib_oemv_200911218.gps": 46,
    "gavlab_test2_rcvr1.dat": 436,
    "gavlab_test2_rcvr2.dat": 429,
    "gavlab_OnceEachAgain.GPS": 2,
    "gavlab_ParsingData.GPS": 0,
}


def file_of(name):
    return require_shared(f"data/oem/{name}")


def make(runs, name, path, *options):
    return runs.make(f"log_{name}", SYSTEM, f"log:={path}", "--no-report", *options)[0]


@pytest.fixture(scope="module", params=SPEEDS)
def run_of(runs, shared, request):
    """Return the runs of real logs by the name of the log; two runs are made at a time."""
    # Each run has a DDS domain of its own unless the user has set one for all.
    workers = 1 if "ROS_DOMAIN_ID" in os.environ else 2
    with concurrent.futures.ThreadPoolExecutor(workers) as pool:
        made = {
            name: pool.submit(make, runs, name, shared / "data/oem" / name)
            for name in LOGS
            if (name in SLOW_LOGS) == request.param and (shared / "data/oem" / name).is_file()
        }
    return {name: run.result() for name, run in made.items()}


@pytest.fixture(scope="module")
def own_log(tmp_path_factory):
    path = tmp_path_factory.mktemp("log") / "own.gps"
    path.write_bytes(receiver_log(OWN_SECONDS))
    return path


@pytest.fixture(scope="module")
def own_run(runs, own_log):
    return make(runs, "own", own_log)


def messages(run, topic, namespace="deputy"):
    """Return log time and message of a topic of the receiver, none if nothing was published."""
    reader = BagReader(run)
    name = f"/{namespace}/gnss/{topic}"
    return list(reader.messages(name)) if name in reader.topics else []


def epochs(run, topic="high_rate", namespace="deputy"):
    return [
        conversions.observations_from_message(decoded.message)
        for decoded in messages(run, topic, namespace)
    ]


def without_log_name(epoch):
    return dataclasses.replace(epoch, log_name="")


#: GLONASS ephemerides of the logs that have some.
GLONASS_EPHEMERIDES = {"rtklib_oemv_200911218.gps": 5, "edie_ascii_vectors.asc": 1}


def published_epochs(events):
    """Apply the documented rule: an epoch in a second format is left out if the first had signals.

    The bag is read by log time, so the epochs are sorted.
    """
    kept = []
    for event in events:
        if isinstance(event, ObservationEpoch):
            if kept and kept[-1].time == event.time and len(kept[-1]) > 0:
                continue
            kept.append(event)
    return sorted(map(without_log_name, kept), key=lambda epoch: epoch.time)


def same_values(left, right, names):
    """Whether two lists of dataclasses agree in all fields; NaN equals NaN."""
    assert len(left) == len(right)
    for one, other in zip(left, right, strict=True):
        for name in names:
            mine, theirs = getattr(one, name), getattr(other, name)
            if isinstance(mine, (float, tuple)):
                assert np.array_equal(mine, theirs, equal_nan=True), name
            else:
                assert mine == theirs, name
    return True


def test_the_bag_holds_what_the_log_holds(own_log, own_run):
    assert_bag_holds_log(own_run, own_log, OWN_LOG)
    assert_log_times_are_stamps(own_run, 40)


def test_the_bags_of_real_logs_hold_what_the_logs_hold(run_of):
    assert len(run_of) == 4
    for name, run in run_of.items():
        counts = LOGS[name]
        assert_bag_holds_log(run, file_of(name), counts, GLONASS_EPHEMERIDES.get(name, 0))
        assert_log_times_are_stamps(run, min(counts[4], 40))


def assert_bag_holds_log(run, path, counts, glonass_ephemeris_count=0):
    """Compare a bag with its log: `counts` are numbers of the kinds of messages, see `LOGS`."""
    events = list(read_log(path, raw_logs="all"))
    epoch_count, whole_count, ephemeris_count, fix_count, log_count = counts

    expected = published_epochs(events)
    assert epochs(run) == expected
    assert len(expected) == epoch_count
    whole = [epoch for epoch in expected if epoch.time.nanoseconds % SECOND == 0]
    assert epochs(run, "epoch") == whole
    assert len(whole) == whole_count

    expected = [event for event in events if isinstance(event, BroadcastEphemeris)]
    found = [conversions.ephemeris_from_message(d.message) for d in messages(run, "ephemeris")]
    expected.sort(key=lambda ephemeris: ephemeris.time)
    assert same_values(found, expected, EPHEMERIS_FIELDS)
    assert len(found) == ephemeris_count

    expected = [event for event in events if isinstance(event, GlonassEphemeris)]
    expected.sort(key=lambda ephemeris: ephemeris.time)
    found = [
        conversions.glonass_ephemeris_from_message(d.message)
        for d in messages(run, "glonass_ephemeris")
    ]
    assert found == expected
    assert len(found) == glonass_ephemeris_count

    expected = [event for event in events if isinstance(event, Fix)]
    found = [conversions.fix_from_message(d.message) for d in messages(run, "fix")]
    assert same_values(found, expected, FIX_FIELDS)
    assert len(found) == fix_count

    expected = [event for event in events if isinstance(event, RawLog)]
    found = [conversions.raw_log_from_message(d.message) for d in messages(run, "raw")]
    assert collections.Counter(found) == collections.Counter(expected)
    assert len(found) == log_count


def assert_log_times_are_stamps(run, smallest_count):
    """Compare the log times of a bag with the stamps of its messages."""
    compared = 0
    for topic in ("high_rate", "epoch", "ephemeris", "glonass_ephemeris", "fix", "raw"):
        for decoded in messages(run, topic):
            stamp = to_nanoseconds(decoded.message.header.stamp)
            # A raw log without a time has no stamp: it is recorded at the time of the run.
            assert decoded.log_time == stamp or (topic == "raw" and stamp == 0)
            compared += stamp != 0
            frames = {"deputy/gnss_antenna", "earth"}
            assert decoded.message.header.frame_id in frames
    assert compared >= smallest_count
    clock = [
        (d.log_time, to_nanoseconds(d.message.clock)) for d in BagReader(run).messages("/clock")
    ]
    assert all(log_time == time and time % SECOND == 0 for log_time, time in clock)


def rtklib_epochs(path):
    """Return time and signals of each epoch as RTKLIB decodes them."""
    rtklib = pytest.importorskip("pyrtklib", reason="the referee decoder is not installed")
    systems = {1: constants.SYSTEM_GPS, 2: constants.SYSTEM_SBAS, 4: constants.SYSTEM_GLONASS}
    raw = rtklib.raw_t()
    rtklib.init_raw(raw, rtklib.STRFMT_OEM4)
    file = rtklib.FileWrapper(str(path), "rb")
    found = []
    while (result := rtklib.input_oem4f(raw, file)) != -2:
        if result != 1:
            continue
        time = raw.obs.data[0].time
        signals = {}
        for i in range(raw.obs.n):
            observation = raw.obs.data[i]
            number = rtklib.Arr1Dint(1)
            system = systems[rtklib.satsys(observation.sat, number)]
            prn = number[0] - (100 if system == constants.SYSTEM_SBAS else 0)
            for j in range(rtklib.NFREQ + rtklib.NEXOBS):
                if observation.code[j]:
                    key = (system, prn, rtklib.code2obs(observation.code[j]))
                    signals[key] = (observation.P[j], observation.L[j], observation.D[j])
        nanoseconds = (time.time - UNIX_TIME_OF_GPS_EPOCH) * SECOND + round(time.sec * SECOND)
        found.append((nanoseconds, signals))
    return found


def test_observations_equal_those_of_an_independent_decoder(run_of):
    compared = run_of.keys() & RTKLIB_EPOCHS.keys()
    assert len(compared) >= 2
    for name in sorted(compared):
        assert_equal_to_rtklib(run_of[name], file_of(name), RTKLIB_EPOCHS[name])


def assert_equal_to_rtklib(run, path, count):
    theirs = rtklib_epochs(path)
    ours = epochs(run)
    assert len(ours) == len(theirs) == count, path
    for epoch, (nanoseconds, reference) in zip(ours, theirs, strict=True):
        assert epoch.time.nanoseconds == nanoseconds
        signals = {
            (system, prn, f"{band}{chr(attribute)}"): index
            for index, (system, prn, band, attribute) in enumerate(
                zip(*(getattr(epoch, n).tolist() for n in ("system", "prn", "band", "attribute")),
                    strict=True)
            )
        }  # fmt: skip
        assert set(signals) == set(reference)
        for key, (pseudorange, carrier_phase, doppler) in reference.items():
            index = signals[key]
            assert epoch.pseudorange[index] == pseudorange
            assert epoch.doppler_hz[index] == doppler
            # RTKLIB has no GLONASS phase (1e-9) until it knows the channel.
            if carrier_phase != 1e-9 or key[0] != constants.SYSTEM_GLONASS:
                assert epoch.carrier_phase_cycles[index] == carrier_phase


def contents(run):
    """Return log times and bytes of all messages by topic, without what tells of wall time."""
    by_topic = collections.defaultdict(list)
    for raw in BagReader(run).raw_messages():
        if raw.topic not in ("/diagnostics", "/rosout", "/sim/step_done"):
            by_topic[raw.topic].append((raw.log_time, bytes(raw.serialized)))
    return dict(by_topic)


def test_runs_are_equal_byte_for_byte(runs, own_log, own_run):
    first = contents(own_run)
    assert len(first) == 6
    assert contents(make(runs, "again", own_log)) == first
    assert contents(make(runs, "distributed", own_log, "--distributed")) == first


def test_a_damaged_log_gives_exactly_its_intact_frames(runs, tmp_path):
    """Damaged in 60 places and cut off: what is published is whole, and nothing whole is lost."""
    path = file_of("gavlab_test2_rcvr2.dat")
    content = bytearray(path.read_bytes()[:200_000])
    generator = random.Random(20161121)
    for position in generator.sample(range(len(content)), 60):
        content[position] ^= generator.randrange(1, 256)
    damaged_path = tmp_path / "two words 100%.gps"
    damaged_path.write_bytes(content)
    run = make(runs, "damaged", damaged_path)

    intact = [
        event
        for event in read_log(path, raw_logs="all")
        if isinstance(event, RawLog) and event.content in content
    ]
    found = [conversions.raw_log_from_message(d.message) for d in messages(run, "raw")]
    assert collections.Counter(found) == collections.Counter(intact)
    assert 400 < len(found) < 879 * 200_000 / 289_640

    originals = {
        event.time: event for event in read_log(path) if isinstance(event, ObservationEpoch)
    }
    damaged = epochs(run)
    assert len(damaged) == sum(log.name == "RANGECMPB" for log in intact)
    for epoch in damaged:
        original = originals[epoch.time]
        for name, column in epoch.columns().items():
            if name != "flags":  # after a lost epoch a loss of lock may be seen differently
                assert np.array_equal(column, original.columns()[name]), name


def test_two_receivers_in_one_system(tmp_path):
    """The chief's log gives the time; the deputy's follows it."""
    paths = {
        "chief": file_of("gavlab_test2_rcvr1.dat"),
        "deputy": file_of("gavlab_test2_rcvr2.dat"),
    }
    drivers = [
        {
            "package": "vtff_nav",
            "executable": "receiver_driver",
            "namespace": craft,
            "parameters": {"port": f"file://{path}", "publish_clock": craft == "chief"},
            **({"ends_run": True} if craft == "chief" else {"lockstep": "participant"}),
        }
        for craft, path in paths.items()
    ]
    recorder = parse_yaml((SYSTEMS / SYSTEM).read_text())["nodes"][-1]
    system = tmp_path / "two_receivers.yaml"
    system.write_text(format_yaml({"nodes": [*drivers, recorder]}))
    out = tmp_path / "run"
    result = run_vtff("run", system, "--no-report", "--out", out)
    assert result.returncode == 0, result.stdout

    expected = {craft: published_epochs(read_log(path)) for craft, path in paths.items()}
    assert epochs(out, namespace="chief") == expected["chief"]
    clock = [to_nanoseconds(d.message.clock) for d in BagReader(out).messages("/clock")]
    within = [
        epoch
        for epoch in expected["deputy"]
        if clock[0] - SECOND < epoch.time.to_unix_nanoseconds() <= clock[-1]
    ]
    assert epochs(out, namespace="deputy") == within
    assert len(within) > 400
    # A latched ephemeris is of use even when it came before the start.
    assert len(messages(out, "ephemeris", "deputy")) == LOGS["gavlab_test2_rcvr2.dat"][2]


def test_a_file_that_is_no_receiver_log_fails_in_one_line(tmp_path):
    path = tmp_path / "picture.png"
    path.write_bytes(random.Random(1).randbytes(200_000))
    result = run_vtff("run", SYSTEMS / SYSTEM, f"log:={path}", "--out", tmp_path / "run")
    assert result.returncode == 2
    assert "no NovAtel log that vtff reads was found in" in result.stdout
    assert not (tmp_path / "run").exists()
    assert "Traceback" not in result.stdout + result.stderr


def test_a_missing_log_is_named(tmp_path):
    path = tmp_path / "missing.gps"
    result = run_vtff("run", SYSTEMS / SYSTEM, f"log:={path}", "--out", tmp_path / "run")
    assert result.returncode == 2
    assert f"argument 'log': no file '{path}'" in result.stdout.replace("\n", "")
    assert "Traceback" not in result.stdout + result.stderr
