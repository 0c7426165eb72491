"""Makes an interface finish its frames: ``network_offload.py INTERFACE``.

A virtual interface leaves checksums and the division into frames to its receiver. A relay that
forwards what it reads would then forward frames that the other host refuses.
"""

from __future__ import annotations

import array
import contextlib
import fcntl
import socket
import struct
import sys

SIOCETHTOOL = 0x8946
#: ethtool commands that set checksums of sent frames, segmentation of TCP, and of all packets.
SETTERS = (0x17, 0x1F, 0x24)

with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as opened:
    for setter in SETTERS:
        value = array.array("B", struct.pack("II", setter, 0))
        request = struct.pack("16sP", sys.argv[1].encode(), value.buffer_info()[0])
        with contextlib.suppress(OSError):  # not every interface has each of them
            fcntl.ioctl(opened, SIOCETHTOOL, request)
