"""Fast DDS profile of a run on several machines: unicast between named addresses only.

The participants of a host bind to the address of the host, and announce themselves to the addresses
of all hosts of the run; nothing is sent to a multicast group. Two runs on one network do not meet,
because neither knows the addresses of the other, or, on the same hosts, the DDS domains differ.
"""

from __future__ import annotations

import pathlib
from collections.abc import Sequence

from vtff_node.executables import share_file

__all__ = ["PROFILE_FILE", "profile_text", "write_profile"]

#: Name of the profile in the run folder.
PROFILE_FILE = "fastdds_hosts.xml"

#: Participants of a host that may join by hand, such as a viewer, beside the nodes of the run.
SPARE_PARTICIPANTS = 6

# The line of the profile for several machines after which the additions of its transport stand.
_TRANSPORT_END = "<receiveBufferSize>4194304</receiveBufferSize>"
_DISCOVERY_START = "<builtin>"


def write_profile(
    run_directory: pathlib.Path, own_address: str, addresses: Sequence[str], participants: int
) -> pathlib.Path:
    """Write the profile of one host into its run folder; return the file.

    Parameters
    ----------
    run_directory
        Folder of the run on this host.
    own_address
        IPv4 address of this host.
    addresses
        IPv4 addresses of all hosts of the run, this one included.
    participants
        Largest number of node processes on a host.

    Raises
    ------
    ExecutableNotFoundError
        If the profiles of vtff are not installed.
    OSError
        If the file cannot be written.
    """
    general = share_file("vtff_bringup", "config/dds/fastdds_network.xml")
    text = profile_text(general.read_text(encoding="utf-8"), own_address, addresses, participants)
    path = run_directory / PROFILE_FILE
    path.write_text(text, encoding="utf-8")
    return path


def profile_text(
    general: str, own_address: str, addresses: Sequence[str], participants: int
) -> str:
    """Return the profile for several machines, narrowed to named addresses.

    Parameters
    ----------
    general
        Text of ``config/dds/fastdds_network.xml``.
    own_address, addresses, participants
        As for `write_profile`.
    """
    transport = (
        f"<interfaceWhiteList><address>{own_address}</address></interfaceWhiteList>"
        # Unicast peers are announced to port by port: one for each participant of a host.
        f"<maxInitialPeersRange>{participants + SPARE_PARTICIPANTS}</maxInitialPeersRange>"
    )
    peers = "".join(
        f"<locator><udpv4><address>{address}</address></udpv4></locator>"
        for address in dict.fromkeys([own_address, *addresses])
    )
    # A unicast locator of its own keeps a participant from adding a multicast group.
    discovery = (
        f"<metatrafficUnicastLocatorList><locator><udpv4><address>{own_address}</address></udpv4>"
        f"</locator></metatrafficUnicastLocatorList><initialPeersList>{peers}</initialPeersList>"
    )
    narrowed = general
    for anchor, addition, after in (
        (_TRANSPORT_END, transport, True),
        (_DISCOVERY_START, discovery, True),
    ):
        if narrowed.count(anchor) != 1:
            raise ValueError(f"the DDS profile has {anchor} not exactly once")
        narrowed = narrowed.replace(anchor, anchor + addition if after else addition + anchor)
    return narrowed
