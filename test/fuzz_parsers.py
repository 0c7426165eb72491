#!/usr/bin/env python3
"""Coverage-guided fuzzing of everything that reads bytes from outside.

Each parser gets mutated and random inputs. Only its documented exceptions may leave it, an input
may take at most `LARGEST_TIME` of processor and `LARGEST_GROWTH` of memory. An input that reaches
a new line of code joins the corpus. The first inputs are made by the project's own encoders and
configuration files; nothing is stored in the repository.

    python test/fuzz_parsers.py --inputs 1000000 --parser rinex_observation
    python test/fuzz_parsers.py --engine atheris --seconds 600 --parser receiver

A finding is one line and a file with the input in the folder of --findings; the exit code is 1.
"""

from __future__ import annotations

import argparse
import contextlib
import copy
import faulthandler
import functools
import logging
import mmap
import os
import pathlib
import pickle
import random
import re
import resource
import signal
import struct
import sys
import tempfile
import time
import traceback
import warnings
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple
from unittest import mock

ROOT = pathlib.Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT / "test"), *(str(path) for path in sorted(ROOT.glob("src/*/test")))]

LARGEST_TIME = 5.0  # s of processor for one input; tracing makes code several times slower
LARGEST_GROWTH = 300_000  # kB of memory for one input
LARGEST_ADDRESS_SPACE = 6 << 30  # bytes, so that a fault does not take the machine down
LARGEST_INPUT = 40_000  # bytes
LARGEST_CORPUS = 400  # inputs
FEWEST_INPUTS = 6  # of each parser, however slow the machine is
ALWAYS_TRACED = 2000  # inputs; of those that follow, one in `TRACED_EACH` is traced
TRACED_EACH = 10  # tracing takes longer than parsing
REPORT_INTERVAL = 60.0  # s between lines of progress
SOURCE_FOLDER = str(ROOT / "src") + os.sep

Parse = Callable[[bytes], None]


class Parser(NamedTuple):
    """One parser under test.

    ``corpus`` returns first inputs, ``prepare`` the function that parses an input in a folder for
    files, ``expected`` are the documented exceptions, ``repair`` makes checksums right again, and
    ``tokens`` are texts that the format gives a meaning. ``change`` makes a new input of two where
    `mutate`, which changes bytes, would make nothing that can be read.
    """

    corpus: Callable[[], list[bytes]]
    prepare: Callable[[pathlib.Path], Parse]
    expected: tuple[type[Exception], ...] = ()
    repair: Callable[[bytes, random.Random], bytes] | None = None
    tokens: tuple[bytes, ...] = ()
    change: Callable[[bytes, bytes, random.Random], bytes] | None = None


class InputTakesTooLong(BaseException):
    """An input takes more processor time than allowed; no handler of a parser takes it."""


# ---- receiver stream ---------------------------------------------------------------------------


def _receiver_corpus() -> list[bytes]:
    from encoder_test_support import receiver_log

    log = receiver_log(2, satellite_count=3)
    ascii_log = b"#TIMEA,COM1,0,60.0,FINESTEERING,1889,90000.000,00000000,9924,0;VALID,0,0,-17.0"
    ascii_log += b",2016,3,21,1,0,0,VALID*"
    return [log, receiver_log(1, satellite_count=1), ascii_log + b"00000000\r\n", b"<ERROR:x\r\n"]


def _prepare_receiver(folder: pathlib.Path) -> Parse:
    from vtff_gnss.novatel.stream import ReceiverLogStream

    def parse(content: bytes) -> None:
        stream = ReceiverLogStream(raw_logs="all")
        cut = len(content) // 3
        stream.feed(content[:cut])
        stream.feed(content[cut:])
        stream.close()

    return parse


_ASCII_LOG = re.compile(rb"#([A-Z0-9]+A,[^*]*)\*[0-9A-Fa-f]{8}")


def _repair_receiver(content: bytes, generator: random.Random) -> bytes:
    """Write the checksum of frames anew, and sometimes their message number."""
    from vtff_gnss.novatel.framing import crc32_novatel
    from vtff_gnss.novatel.message_ids import PAYLOAD_LAYOUTS

    repaired = bytearray(content)
    start = repaired.find(b"\xaa\x44\x12")
    while 0 <= start <= len(repaired) - 32:
        if generator.random() < 0.05:
            number = generator.choice(list(PAYLOAD_LAYOUTS))
            struct.pack_into("<H", repaired, start + 4, number)
        end = (
            start + repaired[start + 3] + int.from_bytes(repaired[start + 8 : start + 10], "little")
        )
        if end + 4 <= len(repaired):
            struct.pack_into("<I", repaired, end, crc32_novatel(bytes(repaired[start:end])))
        start = repaired.find(b"\xaa\x44\x12", start + 3)
    return _ASCII_LOG.sub(
        lambda log: b"#%b*%08x" % (log[1], crc32_novatel(log[1])), bytes(repaired)
    )


# ---- RINEX -------------------------------------------------------------------------------------


def _rinex_observation_corpus() -> list[bytes]:
    import gzip

    from encoder_test_support import TIME, gps_observation_epoch
    from rinex_test_support import epoch_3, header_2, header_3, types_3, value

    from vtff_gnss.rinex.write.observation import format_rinex_observation

    epochs = [gps_observation_epoch(2, time=TIME + second) for second in range(2)]
    version_3 = format_rinex_observation(epochs, marker_name="X", interval=1.0).encode()
    event = header_3(types_3("G", "C1C", "L1C", "S1C")) + epoch_3(0.0, 1)
    event += "G05" + value(2e7) + value(1e8, 1, 7) + value(45.0) + "\n" + epoch_3(1.0, 1, 4)
    event += f"{'comment':<60}COMMENT\n" + epoch_3(2.0, 1, 6) + "G05" + value(1.0) * 3 + "\n"
    version_2 = header_2("C1", "L1", "P2", "L2") + " 24  1 10  0  0  0.0000000  0  2G05G 7\n"
    version_2 += (value(2e7) + value(1e8) + value(2e7) + value(8e7) + "\n") * 2
    return [version_3, event.encode(), version_2.encode(), gzip.compress(version_3)]


def _prepare_rinex_observation(folder: pathlib.Path) -> Parse:
    from vtff_gnss.rinex.observation import parse_rinex_observation

    def parse(content: bytes) -> None:
        # Compact RINEX is restored by a program of its own, a process for each input.
        if b"COMPACT RINEX" not in content[:80] and content[:2] != b"\x1f\x9d":
            parse_rinex_observation(content, "fuzz.rnx")

    return parse


def _rinex_navigation_corpus() -> list[bytes]:
    from dataclasses import replace

    from encoder_test_support import nominal_ephemeris

    from vtff_gnss import constants as c
    from vtff_gnss.ionosphere_parameters import KlobucharParameters, NeQuickParameters
    from vtff_gnss.rinex.write.navigation import format_rinex_navigation

    gps = nominal_ephemeris()
    galileo = replace(
        gps, system=c.SYSTEM_GALILEO, source=c.EPHEMERIS_SOURCE_INAV, prn=11, accuracy=3.12
    )
    klobuchar = KlobucharParameters((1e-8, 0.0, 0.0, 0.0), (9e4, 0.0, 0.0, 0.0))
    nequick = NeQuickParameters((50.0, 0.1, 0.0))
    text = format_rinex_navigation([gps, galileo], klobuchar, nequick, 18)
    record = format_rinex_navigation([gps]).split("END OF HEADER")[1].lstrip().removeprefix("\n")
    version_4 = f"{'     4.00           NAVIGATION DATA     M':<60}RINEX VERSION / TYPE\n"
    version_4 += f"{'':60}END OF HEADER\n> EPH G07 LNAV\n{record}> ION G07 LNAV\n"
    version_4 += "    2016 03 21 01 00 00" + " 1.000000000000E-08" * 3 + "\n"
    version_4 += ("    " + " 1.000000000000E-08" * 4 + "\n") * 2
    version_2 = f"{'     2.11           N: GPS NAV DATA':<60}RINEX VERSION / TYPE\n"
    version_2 += f"{'':60}END OF HEADER\n"
    lines = record.splitlines()
    version_2 += " 7 16  3 21  2  0  0.0" + lines[0][23:] + "\n"
    version_2 += "".join(line[1:] + "\n" for line in lines[1:8])
    return [text.encode(), version_4.encode(), version_2.encode()]


def _prepare_rinex_navigation(folder: pathlib.Path) -> Parse:
    from vtff_gnss.rinex.navigation import parse_rinex_navigation

    def parse(content: bytes) -> None:
        if content[:2] != b"\x1f\x9d":
            parse_rinex_navigation(content, "fuzz.rnx")

    return parse


# ---- SimREMOTE ---------------------------------------------------------------------------------


def _simremote_corpus() -> list[bytes]:
    lines = b"*IDN?\nSC,a.scn\n0,MOT,v1_m1,7e6,0,0\n0,mot,V2_M1,7.1e6,0,0\nAR\nRU\nTIME\n"
    more = (
        b"00:00:01.5,MOTB,v1_m1,0.1,0.2,400e3,1,2,3\n-,POW_LEV,v1_a1,1,0,1.5,0,0,0,0,0\n-,EN\nRW\n"
    )
    return [
        lines + more,
        lines + b"\r\n1.0,MOT,v1_m1,7e6,0,0\n1.0,MOT,v2_m1,7e6,0,0\nNULL\nEN,1\nZEROED\n",
        b"SC,a.scn\nSTART_TIME,22-Mar-2017 02:00:18,01:00:00,0\nINIT_POS,v1_m1,10,20,400e3\nTR,0\n",
    ]


def _prepare_simremote_server(folder: pathlib.Path) -> Parse:
    from vtff_sim_bridge.simgen.emulator_state import ScenarioMachine
    from vtff_sim_bridge.simgen.simremote_server import CommandSplitter
    from vtff_sim_bridge.simremote.language import format_reply, parse_reply

    def parse(content: bytes) -> None:
        machine, splitter = ScenarioMachine(("v1_m1", "v2_m1")), CommandSplitter()
        commands = splitter.feed(content[: len(content) // 2])
        commands += splitter.feed(content[len(content) // 2 :]) + splitter.flush()
        for command in commands:
            reply = machine.execute(command.decode("ascii", "replace"))
            if reply is not None:
                sent = format_reply(reply).encode("ascii", "xmlcharrefreplace").decode()
                assert parse_reply(sent).status == reply.status

    return parse


def _reply_corpus() -> list[bytes]:
    return [
        b"<msg><status> 5 </status><data> 12.5 </data></msg>",
        b"<msg> <status>2</status><error> MOT: &lt;x&gt; &amp; </error><fatal>no</fatal> </msg>",
        b"<msg><status> 2 </status><data><a><b/></a></data></msg>",
    ]


def _prepare_simremote_reply(folder: pathlib.Path) -> Parse:
    from vtff_sim_bridge.simremote.language import parse_reply

    return lambda content: _ignore(parse_reply(content.decode("utf-8", "replace")))


def _datagram_corpus() -> list[bytes]:
    numbers = [7e6, 0.0, 0.0, 0.0, 7.5e3, 0.0] + [0.0] * 18
    return [
        struct.pack("<4I24di4x", kind, action, 1000, 1, *numbers, 0)
        for kind in (0, 1)
        for action in (0, 1)
    ]


def _prepare_simremote_datagram(folder: pathlib.Path) -> Parse:
    from vtff_sim_bridge.simgen.emulator_state import CommandRefusedError, ScenarioMachine
    from vtff_sim_bridge.simremote.motion import MotionError
    from vtff_sim_bridge.simremote.udp_motion import parse_datagram

    def parse(content: bytes) -> None:
        command = parse_datagram(content)
        machine = ScenarioMachine(("v1_m1",))
        for line in ("SC,a", "0,MOT,v1_m1,7e6,0,0", "RU"):
            machine.execute(line)
        with contextlib.suppress(CommandRefusedError, MotionError):
            machine.command_motion(command.vehicle_id, command.time_nanoseconds, command.motion)

    return parse


# ---- CAN ---------------------------------------------------------------------------------------

_CAN_FRAME = struct.Struct("<HB8s")  # identifier, length and bits of the kind, bytes
DBC_FILE = ROOT / "config" / "can" / "vtff_thruster.dbc"


@functools.cache
def _can_frames() -> tuple[tuple[int, int], ...]:
    """Return identifier and length of the frames that a thruster sends."""
    import cantools

    database: Any = cantools.database.load_file(DBC_FILE)
    names = ("ThrustReportRT", "ThrustReportN", "ThrusterHeartbeat")
    return tuple((m.frame_id, m.length) for m in map(database.get_message_by_name, names))


def _can_corpus() -> list[bytes]:
    return [b"".join(_CAN_FRAME.pack(*frame, bytes(8)) for frame in _can_frames()) * 2]


def _prepare_can(folder: pathlib.Path) -> Parse:
    import can

    from vtff_control.thruster.can_frames import FrameError, ThrusterFrames

    frames = ThrusterFrames(DBC_FILE)

    def parse(content: bytes) -> None:
        for start in range(0, len(content) - _CAN_FRAME.size + 1, _CAN_FRAME.size):
            number, bits, payload = _CAN_FRAME.unpack_from(content, start)
            frame = can.Message(
                arbitration_id=number & 0x7FF,
                data=payload[: min(bits & 0x0F, 8)],
                is_extended_id=bool(bits & 0x10),
                is_remote_frame=bool(bits & 0x20),
                is_error_frame=bool(bits & 0x40),
            )
            # An error costs the frame; the next one can be decoded.
            with contextlib.suppress(FrameError):
                frames.decode(frame)

    return parse


def _repair_can(content: bytes, generator: random.Random) -> bytes:
    """Write known identifiers and right lengths and checksums into most frames."""
    from vtff_control.bus.checksum import checksum

    repaired = bytearray(content)
    for start in range(0, len(content) - _CAN_FRAME.size + 1, _CAN_FRAME.size):
        if generator.random() < 0.2:
            continue
        number, length = generator.choice(_can_frames())
        payload = bytearray(content[start + 3 : start + 11])
        payload[0] = checksum(number, bytes(payload[:length]))
        _CAN_FRAME.pack_into(repaired, start, number, length, bytes(payload))
    return bytes(repaired)


def _prepare_dbc(folder: pathlib.Path) -> Parse:
    from vtff_control.thruster.can_frames import ThrusterFrames

    def parse(content: bytes) -> None:
        ThrusterFrames(_write(folder, "fuzz.dbc", content))

    return parse


# ---- bags --------------------------------------------------------------------------------------


def _bag(compression: str = "none", count: int = 30) -> pathlib.Path:
    from bag_samples import sample_messages, write_bag

    folder = pathlib.Path(tempfile.mkdtemp(prefix="fuzz_bag_")) / "bag"
    write_bag(folder, sample_messages(count, topics=2), topics=2, compression=compression)
    return folder


def _mcap_corpus() -> list[bytes]:
    contents = []
    for compression in ("none", "zstd", "lz4"):
        with contextlib.suppress(ValueError, TypeError):
            contents.append(next(_bag(compression).glob("*.mcap")).read_bytes())
    return contents


def _repair_mcap(content: bytes, generator: random.Random) -> bytes:
    """Switch the checksum of the first chunk and of the summary off: zero means not checked."""
    repaired = bytearray(content)
    position = 8
    while position + 9 <= len(repaired):
        opcode, length = struct.unpack_from("<BQ", repaired, position)
        if opcode == 0x06 and position + 37 <= len(repaired):
            struct.pack_into("<I", repaired, position + 33, 0)
        if opcode == 0x02 and position + 29 <= len(repaired):
            struct.pack_into("<I", repaired, position + 25, 0)
        position += 9 + length
    return bytes(repaired)


def _prepare_mcap(folder: pathlib.Path) -> Parse:
    from vtff_bag.file.errors import UnknownTypeError
    from vtff_bag.file.reader import BagReader

    def parse(content: bytes) -> None:
        reader = BagReader(_write(folder, "fuzz.mcap", content))
        for _ in reader.raw_messages():
            pass
        for topic in list(reader.topics)[:3]:
            with contextlib.suppress(UnknownTypeError):
                for _ in reader.messages(topic):
                    pass

    return parse


def _prepare_bag_recovery(folder: pathlib.Path) -> Parse:
    import shutil

    from vtff_bag.file.recover import recover

    def parse(content: bytes) -> None:
        shutil.rmtree(folder / "recovered", ignore_errors=True)
        recover(_write(folder, "fuzz.mcap", content), folder / "recovered")

    return parse


def _metadata_corpus() -> list[bytes]:
    return [(_bag() / "metadata.yaml").read_bytes()]


def _prepare_metadata(folder: pathlib.Path) -> Parse:
    from vtff_bag.file.metadata import parse_stored_metadata
    from vtff_bag.file.reader import BagReader

    bag = folder / "bag"
    bag.mkdir()
    (bag / "bag_0.mcap").write_bytes(next(_bag(count=4).glob("*.mcap")).read_bytes())

    def parse(content: bytes) -> None:
        parse_stored_metadata(content.decode("utf-8", "replace"))
        _write(bag, "metadata.yaml", content)
        BagReader(bag)

    return parse


# ---- YAML files --------------------------------------------------------------------------------

_YAML_TOKENS = (
    b"&a ", b"*a", b"<<: ", b"? ", b"- ", b"[", b"]", b"{", b"}", b"!!python/object:os.system ",
    b"!!binary ", b"!!timestamp ", b"!!int ", b"!!set ", b"!!omap ", b"0x", b"0b", b"0o9", b"1_0",
    b"1:70:80", b"2016-99-99", b"2016-03-21T99:00:00Z", b".inf", b"-.inf", b".nan", b"1e400",
    b"-1e-400", b"null", b"~", b"true", b"no", b"''", b'"\\x00"', b'"\\ud800"', b"|\n", b">\n",
    b"---\n", b"...\n", b"%YAML 9.9\n", b"\t", b"\xef\xbb\xbf", b"\xff\xfe", b"9" * 400, b"-1",
    b"0", b"1e300", b"${a}", b"${run_directory}", b"../../../x", b"/dev/null", b"[[[[[[[[",
    b"[" * 3000, b"{a: " * 1500, b"- " * 1500, b": ", b"\n", b"  ", b"#", b"'", b'"',
)  # fmt: skip


def _yaml_corpus(folder: str) -> Callable[[], list[bytes]]:
    def corpus() -> list[bytes]:
        contents = [path.read_bytes() for path in sorted((ROOT / "config" / folder).glob("*.yaml"))]
        return contents + [b"a: &a [1, 1]\nb: &b [*a, *a]\nc: [*b, *b]\n"]

    return corpus


def _prepare_scenario(folder: pathlib.Path) -> Parse:
    from vtff_sim_bridge.truth.scenario import load_scenario

    return lambda content: _ignore(load_scenario(_write(folder, "fuzz.yaml", content)))


def _prepare_gnss(folder: pathlib.Path) -> Parse:
    from vtff_sim_bridge.gnss.configuration import load_gnss_configuration

    (folder / "ionosphere").symlink_to(ROOT / "config" / "ionosphere")
    (folder / "gnss").mkdir()
    return lambda content: _ignore(
        load_gnss_configuration(_write(folder / "gnss", "fuzz.yaml", content))
    )


def _prepare_system(folder: pathlib.Path) -> Parse:
    from vtff_bringup.system.system_file import load_system

    for name in ("scenario", "gnss", "params", "can", "ionosphere", "system"):
        if name != "system":
            (folder / name).symlink_to(ROOT / "config" / name)
    (folder / "system").mkdir()
    for path in (ROOT / "config" / "system").glob("*.yaml"):
        (folder / "system" / path.name).symlink_to(path)
    return lambda content: _ignore(load_system(_write(folder / "system", "fuzz.yaml", content)))


def _prepare_campaign(folder: pathlib.Path) -> Parse:
    import scipy.stats  # noqa: F401 (imported by the first distribution, in the time of an input)

    from vtff_bringup.campaign.campaign_file import load_campaign

    return lambda content: _ignore(load_campaign(_write(folder, "fuzz.yaml", content)))


# ---- what YAML files hold: values that are changed, without a text -----------------------------


def _prepare_yaml_text(folder: pathlib.Path) -> Parse:
    from vtff_node.plain_yaml import parse_yaml

    return lambda content: _ignore(parse_yaml(content.decode("utf-8", "replace")))


def _yaml_text_corpus() -> list[bytes]:
    return [
        b"a: &a [1, 2e-4, .inf]\nb: {c: *a, d: 'x', e: \"y\"}\nf: |\n  text\n",
        b"- 2016-03-21T01:00:00Z\n- !!binary aGk=\n- ? k\n  : v\n- <<: {a: 1}\n  b: ~\n",
    ]


def _value_corpus(folder: str) -> Callable[[], list[bytes]]:
    def corpus() -> list[bytes]:
        from vtff_node.plain_yaml import parse_yaml

        paths = sorted((ROOT / "config" / folder).glob("*.yaml"))
        return [pickle.dumps(parse_yaml(path.read_text(encoding="utf-8"))) for path in paths]

    return corpus


def _prepare_values(
    prepare: Callable[[pathlib.Path], Parse],
) -> Callable[[pathlib.Path], Parse]:
    """Return how to prepare a reader of YAML files so that it gets values instead of a text.

    The texts of other files, which an input may name, are read once.
    """

    def prepare_reader(folder: pathlib.Path) -> Parse:
        from vtff_node import plain_yaml

        parse_text = plain_yaml.parse_yaml
        parse_other = functools.cache(parse_text)
        values: list[Any] = [None]

        def take_values(text: str) -> Any:
            if text == _INSTEAD_OF_TEXT:
                return copy.deepcopy(values[0])
            return copy.deepcopy(parse_other(text))

        parse_file = prepare(folder)
        users = [
            module
            for module in list(sys.modules.values())
            if getattr(module, "parse_yaml", None) is parse_text
        ]

        def parse(content: bytes) -> None:
            values[0] = pickle.loads(content) if content else None
            with contextlib.ExitStack() as replaced:
                for module in users:
                    replaced.enter_context(mock.patch.object(module, "parse_yaml", take_values))
                parse_file(_INSTEAD_OF_TEXT.encode())

        return parse

    return prepare_reader


_INSTEAD_OF_TEXT = "values: of an input\n"

_VALUES: tuple[Any, ...] = (
    None, True, False, 0, 1, -1, 2, 3.5, -1e-300, 1e300, float("inf"), float("nan"), 1 << 70, "",
    "x", "chief", "deputy", "/x", "../x", "a/../b", "${run_directory}", "${a}", "${", "\0",
    "\ud800", "*", "lockstep", "1e3", "x" * 3000, [], {}, [None], {"": 0}, {"x": {"y": []}}, {1: 2},
    "2016-03-21", [[[[[1]]]]], ["chief", "chief"],
)  # fmt: skip


def _change_values(first: bytes, other: bytes, generator: random.Random) -> bytes:
    """Return an input with a few changes of values, keys and branches."""
    values = pickle.loads(first)
    for _ in range(1 << generator.randrange(4)):
        branches = [b for b in _branches(values) if b]
        if not branches:
            values = copy.deepcopy(generator.choice(_VALUES))
            continue
        branch = generator.choice(branches)
        key = generator.choice(list(branch) if isinstance(branch, dict) else range(len(branch)))
        kind = generator.randrange(7)
        if kind <= 1:
            branch[key] = copy.deepcopy(generator.choice(_VALUES))
        elif kind == 2:
            del branch[key]
        elif kind == 3:
            foreign = generator.choice([b for b in _branches(pickle.loads(other)) if b] or [{}])
            branch[key] = foreign
        elif kind == 4:
            branch[key] = copy.deepcopy(generator.choice(branches))
        elif kind == 5 and isinstance(branch, dict):
            names = [name for b in branches if isinstance(b, dict) for name in b]
            branch[generator.choice([*names, "", "x", 1, None])] = branch.pop(key)
        elif kind == 6 and isinstance(branch, list):
            branch.insert(generator.randrange(len(branch) + 1), copy.deepcopy(branch[key]))
    changed = pickle.dumps(values)
    return changed if len(changed) < LARGEST_INPUT else first


def _branches(values: Any) -> list[Any]:
    """Return the mappings and lists in a value."""
    if isinstance(values, dict):
        return [values, *(b for value in values.values() for b in _branches(value))]
    if isinstance(values, list):
        return [values, *(b for value in values for b in _branches(value))]
    return []


def _ignore(value: object) -> None:
    """Drop a result."""


def _write(folder: pathlib.Path, name: str, content: bytes) -> pathlib.Path:
    path = folder / name
    path.write_bytes(content)
    return path


def parsers() -> dict[str, Parser]:
    """Return the parsers by name; imports what they need."""
    from vtff_bag.file.errors import BagError
    from vtff_bringup.campaign.campaign_file import CampaignError
    from vtff_bringup.system.errors import SystemFileError
    from vtff_gnss.rinex.errors import RinexError
    from vtff_node.plain_yaml import PlainYamlError
    from vtff_sim_bridge.simremote.language import SimRemoteSyntaxError
    from vtff_sim_bridge.truth.scenario_fields import ScenarioError

    rinex_tokens = (
        b">", b"G05", b"E11", b"R03", b"END OF HEADER", b"\n", b"  ", b"nan", b"1E999", b"-", b".",
        b"D+99", b"SYS / # / OBS TYPES", b"\x1f\x8b", b"BZh", b"PK\x03\x04", b"\x00", b"\x85",
    )  # fmt: skip
    simremote_tokens = (
        b",", b"-,", b"\n", b"\r", b"MOT", b"MOTB", b"v1_m1", b"v2_m1", b"1e308", b"-1e-320",
        b"nan", b"inf", b"99:99:99", b"9 23:59:59.999", b"2000000", b"RU", b"AR_NOWAIT", b"RW",
        b"EN", b"POW_LEV", b"INIT_POS", b"START_TIME", b"31-Feb-2020 00:00:00", b"<msg>",
        b"<status>", b"</msg>", b"<data>", b"</data>", b"&amp;", b"9" * 5000,
    )  # fmt: skip
    bag_tokens = tuple(bytes([opcode]) + struct.pack("<Q", 4) for opcode in range(1, 16))
    return {
        "receiver": Parser(_receiver_corpus, _prepare_receiver, (), _repair_receiver),
        "rinex_observation": Parser(
            _rinex_observation_corpus, _prepare_rinex_observation, (RinexError,), None, rinex_tokens
        ),
        "rinex_navigation": Parser(
            _rinex_navigation_corpus, _prepare_rinex_navigation, (RinexError,), None, rinex_tokens
        ),
        "simremote_server": Parser(
            _simremote_corpus, _prepare_simremote_server, (), None, simremote_tokens
        ),
        "simremote_reply": Parser(
            _reply_corpus, _prepare_simremote_reply, (SimRemoteSyntaxError,), None, simremote_tokens
        ),
        "simremote_datagram": Parser(
            _datagram_corpus, _prepare_simremote_datagram, (SimRemoteSyntaxError,)
        ),
        "can": Parser(_can_corpus, _prepare_can, (), _repair_can),
        "can_database": Parser(
            lambda: [DBC_FILE.read_bytes()],
            _prepare_dbc,
            (ValueError,),
            None,
            (b'"', b" : ", b"\n"),
        ),
        "mcap": Parser(_mcap_corpus, _prepare_mcap, (BagError,), _repair_mcap, bag_tokens),
        "bag_recovery": Parser(
            _mcap_corpus, _prepare_bag_recovery, (BagError,), _repair_mcap, bag_tokens
        ),
        "bag_metadata": Parser(
            _metadata_corpus, _prepare_metadata, (BagError,), None, _YAML_TOKENS
        ),
        "yaml_text": Parser(
            _yaml_text_corpus, _prepare_yaml_text, (PlainYamlError,), None, _YAML_TOKENS
        ),
        "scenario": Parser(
            _yaml_corpus("scenario"), _prepare_scenario, (ScenarioError,), None, _YAML_TOKENS
        ),
        "gnss": Parser(_yaml_corpus("gnss"), _prepare_gnss, (ScenarioError,), None, _YAML_TOKENS),
        "system": Parser(
            _yaml_corpus("system"), _prepare_system, (SystemFileError,), None, _YAML_TOKENS
        ),
        "campaign": Parser(
            _yaml_corpus("campaign"), _prepare_campaign, (CampaignError,), None, _YAML_TOKENS
        ),
        **{
            f"{name}_values": Parser(
                _value_corpus(name), _prepare_values(prepare), errors, change=_change_values
            )
            for name, prepare, errors in (
                ("scenario", _prepare_scenario, (ScenarioError,)),
                ("gnss", _prepare_gnss, (ScenarioError,)),
                ("system", _prepare_system, (SystemFileError,)),
                ("campaign", _prepare_campaign, (CampaignError,)),
            )
        },
    }


# ---- mutation and coverage ---------------------------------------------------------------------

_NUMBERS = (0, 1, 0x7F, 0x80, 0xFF, 0x7FFF, 0xFFFF, 0x7FFFFFFF, 0xFFFFFFFF, (1 << 63) - 1)


def mutate(
    content: bytes, other: bytes, tokens: tuple[bytes, ...], generator: random.Random
) -> bytes:
    """Return a changed input: a few changes of bytes, lines, numbers or tokens."""
    if generator.random() < 0.02:
        return generator.randbytes(generator.randrange(300))
    changed = bytearray(content)
    for _ in range(1 << generator.randrange(5)):
        place = generator.randrange(len(changed) + 1)
        end = min(len(changed), place + (1 << generator.randrange(10)))
        kind = generator.randrange(10)
        if kind == 0 and changed:
            changed[min(place, len(changed) - 1)] ^= 1 << generator.randrange(8)
        elif kind == 1:
            changed[place : place + 1] = generator.randbytes(1)
        elif kind == 2:
            del changed[place:end]
        elif kind == 3:
            changed[place:place] = changed[place:end]
        elif kind == 4 and tokens:
            changed[place:place] = generator.choice(tokens)
        elif kind == 5 and tokens:
            token = generator.choice(tokens)
            changed[place : place + len(token)] = token
        elif kind == 6:
            size = generator.choice((1, 2, 4, 8))
            number = generator.choice(_NUMBERS) & ((1 << 8 * size) - 1)
            changed[place : place + size] = number.to_bytes(size, "little")
        elif kind == 7 and other:
            start = generator.randrange(len(other))
            changed[place:end] = other[start : start + end - place + generator.randrange(20)]
        elif kind == 8:
            lines = changed.split(b"\n")
            first, second = (generator.randrange(len(lines)) for _ in range(2))
            lines[first], lines[second] = lines[second], lines[first]
            changed = bytearray(b"\n").join(lines)
        elif kind == 9:
            # A value of a line of text is replaced, the rest of the line stays.
            line_end = changed.find(b"\n", place)
            colon = changed.rfind(b":", 0, place)
            if 0 <= colon < line_end and tokens:
                changed[colon + 1 : line_end] = b" " + generator.choice(tokens)
    return bytes(changed[:LARGEST_INPUT])


class Coverage:
    """Counts lines of the project that have run; a context in which they can be counted.

    Attributes
    ----------
    lines
        The lines that have been reached.
    """

    def __init__(self) -> None:
        self.lines: set[tuple[Any, int]] = set()
        self._is_ours: dict[Any, bool] = {}

    def __enter__(self) -> Coverage:
        if sys.version_info >= (3, 12):
            monitoring = sys.monitoring
            monitoring.use_tool_id(monitoring.COVERAGE_ID, "fuzz_parsers")
            monitoring.register_callback(
                monitoring.COVERAGE_ID, monitoring.events.LINE, self._on_monitored_line
            )
            monitoring.set_events(monitoring.COVERAGE_ID, monitoring.events.LINE)
        return self

    def trace(self, is_traced: bool) -> None:
        """Count lines from now on, or not; where each line costs time once only, always."""
        if sys.version_info < (3, 12):
            sys.settrace(self._on_call if is_traced else None)

    def __exit__(self, *_: object) -> None:
        if sys.version_info >= (3, 12):
            sys.monitoring.set_events(sys.monitoring.COVERAGE_ID, 0)
            sys.monitoring.free_tool_id(sys.monitoring.COVERAGE_ID)
        else:
            sys.settrace(None)

    def _belongs_to_project(self, code: Any) -> bool:
        is_ours = self._is_ours.get(code)
        if is_ours is None:
            path = os.path.realpath(code.co_filename)
            is_ours = self._is_ours[code] = path.startswith(SOURCE_FOLDER) and "/test/" not in path
        return is_ours

    def _on_monitored_line(self, code: Any, line: int) -> Any:
        if self._belongs_to_project(code):
            self.lines.add((code, line))
        return sys.monitoring.DISABLE if sys.version_info >= (3, 12) else None

    def _on_call(self, frame: Any, event: str, argument: Any) -> Any:
        return self._on_line if self._belongs_to_project(frame.f_code) else None

    def _on_line(self, frame: Any, event: str, argument: Any) -> Any:
        if event == "line":
            self.lines.add((frame.f_code, frame.f_lineno))
        return self._on_line


class Watch:
    """Runs one input after the other with limits on time and memory, and notes what goes wrong.

    Parameters
    ----------
    name, parser
        The parser.
    findings
        Folder for the inputs of findings, and for the input that is being parsed: it is what is
        left when the process itself is ended.
    """

    def __init__(self, name: str, parser: Parser, findings: pathlib.Path) -> None:
        self._name = name
        self._expected = parser.expected
        self._folder = findings
        self._files = tempfile.TemporaryDirectory(prefix=f"fuzz_{name}_")
        self._parse = parser.prepare(pathlib.Path(self._files.name))
        self.findings: dict[tuple[str, str], str] = {}
        findings.mkdir(parents=True, exist_ok=True)
        self._current_file = findings / f"{name}.current"
        self._current_file.write_bytes(bytes(LARGEST_INPUT + 8))
        with self._current_file.open("r+b") as file:
            self._current = mmap.mmap(file.fileno(), 0)
        self._parse_first()

    def _parse_first(self) -> None:
        """Import what parsing imports, without limits."""
        with contextlib.suppress(Exception):
            self._parse(b"")

    def close(self) -> None:
        """Remove the files."""
        self._current.close()
        self._current_file.unlink()
        self._files.cleanup()

    def run(self, content: bytes) -> None:
        """Parse one input."""
        self._current[: len(content) + 8] = struct.pack("<Q", len(content)) + content
        memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        signal.setitimer(signal.ITIMER_PROF, LARGEST_TIME)
        try:
            self._parse(content)
        except self._expected as error:
            # Errors are lines that a person reads.
            if len(str(error)) > 20_000:
                self._note(content, error, "error text of", f"{len(str(error))} characters")
        except InputTakesTooLong as error:
            self._note(content, error, "hang", f"more than {LARGEST_TIME:g} s of processor")
        except Exception as error:
            self._note(content, error, type(error).__name__, str(error)[:200])
        finally:
            signal.setitimer(signal.ITIMER_PROF, 0.0)
        growth = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - memory
        if growth > LARGEST_GROWTH:
            self._note(content, None, "memory", f"{growth // 1000} MB more")

    def _note(self, content: bytes, error: BaseException | None, kind: str, text: str) -> None:
        place = ""
        if error is not None:
            ours = [
                frame
                for frame in traceback.extract_tb(error.__traceback__)
                if os.path.realpath(frame.filename).startswith(SOURCE_FOLDER)
            ]
            if ours:
                path = os.path.relpath(os.path.realpath(ours[-1].filename), SOURCE_FOLDER)
                place = f"{path}:{ours[-1].lineno}"
        if (kind, place) in self.findings:
            return
        file = self._folder / f"{self._name}_{len(self.findings)}"
        file.write_bytes(content)
        line = f"{self._name}: {kind}: {' '.join(text.split())} at {place or '?'}; input: {file}"
        self.findings[kind, place] = line
        print(line, flush=True)


def inputs(parser: Parser, generator: random.Random, coverage: Coverage) -> Iterator[bytes]:
    """Yield the corpus, then mutations; an input that reaches new lines joins the corpus."""
    corpus = list(parser.corpus())
    yield b""
    for content in list(corpus):
        yield content
    while True:
        first, other = generator.choice(corpus), generator.choice(corpus)
        if parser.change is not None:
            content = parser.change(first, other, generator)
        else:
            content = mutate(first, other, parser.tokens, generator)
        if parser.repair is not None and generator.random() < 0.7:
            content = parser.repair(content, generator)[:LARGEST_INPUT]
        before = len(coverage.lines)
        yield content
        if len(coverage.lines) > before:
            if len(corpus) >= LARGEST_CORPUS:
                del corpus[generator.randrange(len(corpus))]
            corpus.append(content)


def fuzz(
    name: str,
    parser: Parser,
    seconds: float,
    seed: int,
    findings: pathlib.Path,
    largest_count: float = float("inf"),
) -> tuple[int, int, int, int]:
    """Parse inputs for some seconds of processor time, or until there were enough of them.

    Returns
    -------
    Number of inputs, of bytes, of lines reached, and of findings.
    """
    watch, coverage = Watch(name, parser, findings), Coverage()
    count = total = 0
    deadline = time.process_time() + seconds
    report_at = time.monotonic() + REPORT_INTERVAL
    with coverage:
        for content in inputs(parser, random.Random(f"{name} {seed}"), coverage):
            coverage.trace(count < ALWAYS_TRACED or count % TRACED_EACH == 0)
            watch.run(content)
            coverage.trace(False)
            count, total = count + 1, total + len(content)
            is_late = time.process_time() >= deadline
            if count >= FEWEST_INPUTS and (is_late or count >= largest_count):
                break
            if time.monotonic() >= report_at:
                report_at += REPORT_INTERVAL
                print(f"{name}: {count} inputs so far", file=sys.stderr, flush=True)
    watch.close()
    return count, total, len(coverage.lines), len(watch.findings)


def fuzz_with_atheris(
    name: str, parser: Parser, seconds: float, seed: int, findings: pathlib.Path
) -> None:
    """Fuzz with libFuzzer through atheris, which is installed by hand; it ends the process."""
    import atheris

    # The modules were imported without instrumentation by `parsers`; the code objects are patched.
    watch = Watch(name, parser, findings)
    atheris.instrument_all()
    folder = findings / f"{name}_corpus"
    folder.mkdir(parents=True, exist_ok=True)
    for number, content in enumerate(parser.corpus()):
        (folder / f"first_{number}").write_bytes(content[:LARGEST_INPUT])

    def run(content: bytes) -> None:
        watch.run(content)

    def change(content: bytes, largest: int, number: int) -> bytes:
        generator = random.Random(number)
        if generator.random() < 0.5:
            content = mutate(content, content, parser.tokens, generator)
        else:
            content = atheris.Mutate(content, min(largest, LARGEST_INPUT))
        if parser.repair is not None and generator.random() < 0.7:
            content = parser.repair(content, generator)
        return content[: min(largest, LARGEST_INPUT)]

    options = [
        f"-max_total_time={seconds:g}", f"-seed={seed + 1}", f"-max_len={LARGEST_INPUT}",
        "-print_final_stats=1", "-verbosity=1", "-rss_limit_mb=3000", str(folder),
    ]  # fmt: skip
    atheris.Setup([sys.argv[0], *options], run, custom_mutator=change)
    atheris.Fuzz()


def set_limits() -> None:
    """Bound memory and time of this process, silence what parsers log and warn."""
    resource.setrlimit(resource.RLIMIT_AS, (LARGEST_ADDRESS_SPACE, LARGEST_ADDRESS_SPACE))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    faulthandler.enable()

    def end_input(number: int, frame: object) -> None:
        raise InputTakesTooLong

    signal.signal(signal.SIGPROF, end_input)
    logging.disable(logging.CRITICAL)
    warnings.simplefilter("ignore")


def main(arguments: list[str] | None = None) -> int:
    """Run the command line; return the exit code."""
    available = parsers()
    reader = argparse.ArgumentParser(
        description="Fuzz the parsers: only documented exceptions, bounded time and memory.",
        epilog="Example: python test/fuzz_parsers.py --seconds 600 --parser rinex_observation",
    )
    reader.add_argument(
        "--seconds", type=float, help="s of processor, each parser (default: 20, or --inputs)"
    )
    reader.add_argument("--inputs", type=int, help="number of inputs, each parser")
    reader.add_argument(
        "--parser", action="append", choices=sorted(available), help="may be repeated; default: all"
    )
    reader.add_argument("--seed", type=int, default=0, help="other seeds try other inputs")
    reader.add_argument(
        "--findings", type=pathlib.Path, default=pathlib.Path("fuzz_findings"),
        help="folder for inputs that were not parsed as they should (default: %(default)s)",
    )  # fmt: skip
    reader.add_argument(
        "--engine", choices=("own", "atheris"), default="own",
        help="atheris: libFuzzer, one parser, if `pip install atheris` was done by hand",
    )  # fmt: skip
    reader.add_argument(
        "--input", type=pathlib.Path, help="parse this file once and say what comes"
    )
    given = reader.parse_args(arguments)
    names = given.parser or list(available)
    seconds = given.seconds or (20.0 if given.inputs is None else float("inf"))
    set_limits()
    failed = False
    for name in names:
        parser = available[name]
        if given.input is not None:
            with tempfile.TemporaryDirectory() as folder:
                parser.prepare(pathlib.Path(folder))(given.input.read_bytes())
            continue
        if given.engine == "atheris":
            fuzz_with_atheris(name, parser, seconds, given.seed, given.findings)
            continue
        count, total, lines, findings = fuzz(
            name, parser, seconds, given.seed, given.findings, given.inputs or float("inf")
        )
        failed = failed or findings > 0
        print(
            f"{name}: {count} inputs, {total} bytes, {lines} lines reached, {findings} findings",
            flush=True,
        )
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
