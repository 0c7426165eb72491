"""The `simgen_emulator` executable: what a SimGEN with SimREMOTE looks like from the network."""

from __future__ import annotations

import argparse
import dataclasses
import logging
import os
import signal
from collections.abc import Sequence
from pathlib import Path

from vtff_node.process.lifeline import watch_lifeline
from vtff_node.process.stop_signals import handle_stop_signals
from vtff_sim_bridge.gnss.configuration import (
    GnssConfiguration,
    assign_vehicles,
    load_gnss_configuration,
)
from vtff_sim_bridge.simgen.emulator_state import CLOCK_MODES, ScenarioMachine
from vtff_sim_bridge.simgen.gnss_emulation import GnssEmulation
from vtff_sim_bridge.simgen.simremote_server import SimRemoteServer
from vtff_sim_bridge.simremote.language import DEFAULT_PORT

_EXIT_REFUSED = 2  # a file or an option is wrong
LOGGER = logging.getLogger("simgen_emulator")

_EPILOG = """\
a session, by hand (nc 127.0.0.1 15650), for --vehicles v1_m1:
  *IDN?                                     who are you
  SC,C:\\scenarios\\leo.scn                   load a scenario      -> status 2, ready
  START_TIME,21-MAR-2016 01:00:00,01:00:00   start and duration
  TR,0                                      start on RU, no trigger
  0,MOT,v1_m1,6863e3,0,0,0,7.1e3,0          where the vehicle is at the start
  AR                                        arm                  -> status 4, armed
  RU                                        run                  -> status 5, running
  1.0,MOT,v1_m1,6862996,7100,0,-8,7100,0    motion from second 1 on
  -,TIME                                    seconds into the run
  -,EN,1                                    end and rewind       -> status 2, ready

clock modes:
  lockstep   the time into the run is the newest time stamp that the motion commands of every
             vehicle have: nothing happens between them, and a run is repeatable
  realtime   it follows the wall clock from RU on, as SimGEN does

Nothing is taken from the .scn file: its name is kept, start and duration come from START_TIME.

receivers:
  --gnss config/gnss/reference.yaml --port-link-directory /tmp/vtff_ports
             adds GNSS receivers on the vehicles; each listens and sends on a pseudo-terminal with
             the symlink DIRECTORY/<name of the receiver>. They send nothing until a driver sends
             LOG commands. The bytes of a time are handed to the ports before the reply to the
             motion command that brought it; a slow reader holds back further commands.
"""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the emulator until SIGINT, SIGTERM or SIGHUP; return the exit code."""
    options = _parser().parse_args(arguments)
    logging.basicConfig(
        level=options.log_level.upper(), format="%(name)s: %(levelname)s: %(message)s"
    )
    try:
        machine = ScenarioMachine(
            options.vehicles, clock_mode=options.clock, arming_delay=options.arming_delay
        )
        receivers = None if options.gnss is None else _gnss_emulation(machine, options)
    except (ValueError, OSError) as error:
        LOGGER.error("cannot start: %s", error)
        return _EXIT_REFUSED
    try:
        server = SimRemoteServer(
            machine, options.host, options.port, accepts_udp=options.udp, companion=receivers
        )
    except OSError as error:
        LOGGER.error("cannot start on %s:%d: %s", options.host, options.port, error)
        if receivers is not None:
            receivers.close()
        return 1
    signal.set_wakeup_fd(server.wakeup_descriptor)
    handle_stop_signals(server.stop)
    watch_lifeline()
    try:
        if options.port_file is not None:
            write_port_file(options.port_file, server.port)
        LOGGER.info("SimREMOTE on %s:%d, %s", options.host, server.port, options.clock)
        server.serve()
        if receivers is not None:
            receivers.close()
    except (ValueError, OSError) as error:
        LOGGER.error("%s", describe_failure(error))
        return 1
    finally:
        signal.set_wakeup_fd(-1)
        server.close()
        if receivers is not None:
            receivers.close()
    LOGGER.info("%d commands, %d errors", server.command_count, server.error_count)
    return 0


def _gnss_emulation(machine: ScenarioMachine, options: argparse.Namespace) -> GnssEmulation:
    """Return the receivers that the options ask for."""
    configuration = load_gnss_configuration(options.gnss, options.seed)
    if options.spacecraft:
        if len(options.spacecraft) != len(options.vehicles):
            raise ValueError(
                f"--spacecraft names {len(options.spacecraft)}, --vehicles {len(options.vehicles)}"
            )
        vehicles = dict(zip(options.spacecraft, options.vehicles, strict=True))
        configuration = assign_vehicles(configuration, vehicles)
    if options.receiver_ports is not None:
        configuration = _with_ports(configuration, dict(options.receiver_ports))
    return GnssEmulation(
        machine,
        configuration,
        options.port_link_directory,
        options.gnss_truth,
        tcp_host=options.host,
    )


def _with_ports(configuration: GnssConfiguration, ports: dict[str, int]) -> GnssConfiguration:
    """Return a configuration whose receivers listen on these TCP ports."""
    names = [receiver.name for receiver in configuration.receivers]
    if set(ports) != set(names):
        raise ValueError(f"--receiver-ports: one for each of {', '.join(names)} is needed")
    receivers = tuple(
        dataclasses.replace(receiver, tcp_port=ports[receiver.name])
        for receiver in configuration.receivers
    )
    return dataclasses.replace(configuration, receivers=receivers)


def describe_failure(error: Exception) -> str:
    """Return why the emulator ends, with the file in front where it is one that failed."""
    if isinstance(error, OSError) and error.filename:
        return f"{error.filename}: {error.strerror}"
    return str(error)


def write_port_file(path: Path, port: int) -> None:
    """Write a port number so that a reader sees the whole file or none.

    Raises
    ------
    OSError
        If the file cannot be written.
    """
    partial = path.with_name(f"{path.name}.{os.getpid()}.partial")
    partial.write_text(f"{port}\n", encoding="ascii")
    partial.replace(path)


def _port_number(text: str) -> int:
    """Return a port number; the error is what argparse shows."""
    if not text.isdecimal() or int(text) > 65535:
        raise argparse.ArgumentTypeError(f"0 to 65535 expected, got {text!r}")
    return int(text)


def _named_port(text: str) -> tuple[str, int]:
    """Return name and port of ``NAME=PORT``; the error is what argparse shows."""
    name, separator, number = text.partition("=")
    if not name or not separator:
        raise argparse.ArgumentTypeError(f"NAME=PORT expected, got {text!r}")
    return name, _port_number(number)


def _seed(text: str) -> int:
    """Return a seed; the error is what argparse shows."""
    if not text.isdecimal():
        raise argparse.ArgumentTypeError(f"a whole number, 0 or more, expected, got {text!r}")
    return int(text)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="simgen_emulator",
        description="Emulator of Spirent SimGEN under SimREMOTE control (text over TCP).",
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--host", default="127.0.0.1", help="address to listen on (%(default)s)")
    parser.add_argument(
        "--port",
        type=_port_number,
        default=DEFAULT_PORT,
        help="TCP port, 0 for any free one (%(default)s, SimGEN's own)",
    )
    parser.add_argument(
        "--port-file", type=Path, metavar="FILE", help="write the port number to this file"
    )
    parser.add_argument(
        "--vehicles",
        nargs="+",
        default=["v1_m1", "v2_m1"],
        metavar="ID",
        help="vehicles of the scenario (v1_m1 v2_m1)",
    )
    parser.add_argument(
        "--spacecraft",
        nargs="+",
        default=[],
        metavar="NAME",
        help="spacecraft of each vehicle: a receiver is on that of its name",
    )
    parser.add_argument(
        "--clock", choices=CLOCK_MODES, default="lockstep", help="what drives time (%(default)s)"
    )
    parser.add_argument(
        "--arming-delay",
        type=float,
        default=0.0,
        metavar="SECONDS",
        help="time that AR takes (%(default)g; a real unit takes 25 to 40)",
    )
    parser.add_argument(
        "--udp", action="store_true", help="also take binary MOT and MOTB datagrams on the port"
    )
    parser.add_argument(
        "--gnss", type=Path, metavar="FILE", help="add the GNSS receivers of this file"
    )
    parser.add_argument(
        "--seed", type=_seed, metavar="NUMBER", help="of all noise, instead of that of the file"
    )
    parser.add_argument(
        "--port-link-directory",
        type=Path,
        metavar="DIRECTORY",
        help="where each receiver gets a symlink to its pseudo-terminal",
    )
    parser.add_argument(
        "--receiver-ports",
        type=_named_port,
        nargs="+",
        metavar="NAME=PORT",
        help="TCP port of each receiver of the file, on the address of --host",
    )
    parser.add_argument(
        "--gnss-truth", type=Path, metavar="FILE", help="write what the receivers were given"
    )
    parser.add_argument(
        "--log-level",
        choices=("debug", "info", "warning", "error"),
        default="info",
        help="debug shows every command (%(default)s)",
    )
    return parser


if __name__ == "__main__":
    raise SystemExit(main())
