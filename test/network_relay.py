"""Forwards Ethernet frames between interfaces, with loss, delay and cuts.

``network_relay.py LOSS DELAY JITTER SEED INTERFACE...``: each frame is lost with probability LOSS,
else forwarded after DELAY plus or minus up to JITTER seconds (uniform), in the order in which the
delays end. Frames go where their destination was last seen, or everywhere. On standard input,
``cut N`` and ``join N`` cut and join the link of the N-th interface; each is answered by itself.
"""

from __future__ import annotations

import heapq
import random
import selectors
import socket
import sys
import time

ETH_P_ALL = 3
PACKET_OUTGOING = 4
LARGEST_FRAME = 65536 + 64  # interfaces may hand over packets before they are segmented
BUFFER = 8 << 20


class Relay:
    """The interfaces and the frames that are on their way."""

    def __init__(
        self, loss: float, delay: float, jitter: float, seed: int, interfaces: list[str]
    ) -> None:
        self._loss = loss
        self._delay = delay
        self._jitter = jitter
        self._random = random.Random(seed)
        self._sockets = []
        for name in interfaces:
            opened = socket.socket(socket.AF_PACKET, socket.SOCK_RAW, socket.htons(ETH_P_ALL))
            opened.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, BUFFER)
            opened.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, BUFFER)
            opened.bind((name, 0))
            opened.setblocking(False)
            self._sockets.append(opened)
        self._seen: dict[bytes, int] = {}
        self._cut: set[int] = set()
        self._waiting: list[tuple[float, int, int, bytes]] = []
        self._count = 0

    def run(self) -> None:
        """Forward until standard input ends."""
        with selectors.DefaultSelector() as selector:
            selector.register(sys.stdin, selectors.EVENT_READ, -1)
            for number, opened in enumerate(self._sockets):
                selector.register(opened, selectors.EVENT_READ, number)
            print("ready", flush=True)
            while True:
                timeout = None
                if self._waiting:
                    timeout = max(0.0, self._waiting[0][0] - time.monotonic())
                for key, _ in selector.select(timeout):
                    if key.data >= 0:
                        self._receive(key.data)
                    elif not self._obey(sys.stdin.readline()):
                        return
                self._send_due()

    def _obey(self, line: str) -> bool:
        words = line.split()
        if not words:
            return False
        (self._cut.add if words[0] == "cut" else self._cut.discard)(int(words[1]))
        print(line, end="", flush=True)
        return True

    def _receive(self, source: int) -> None:
        for _ in range(64):
            try:
                frame, address = self._sockets[source].recvfrom(LARGEST_FRAME)
            except BlockingIOError:
                return
            if address[2] == PACKET_OUTGOING:
                continue
            self._seen[frame[6:12]] = source
            destination = self._seen.get(frame[:6])
            targets = range(len(self._sockets)) if destination is None else [destination]
            for target in targets:
                if target != source:
                    self._take(source, target, frame)

    def _take(self, source: int, target: int, frame: bytes) -> None:
        if source in self._cut or target in self._cut or self._random.random() < self._loss:
            return
        delay = self._delay + self._random.uniform(-self._jitter, self._jitter)
        self._count += 1
        heapq.heappush(self._waiting, (time.monotonic() + delay, self._count, target, frame))

    def _send_due(self) -> None:
        now = time.monotonic()
        while self._waiting and self._waiting[0][0] <= now:
            _, _, target, frame = heapq.heappop(self._waiting)
            try:
                self._sockets[target].send(frame)
            except OSError as error:  # a frame larger than the interface takes
                print(f"relay: {len(frame)} bytes: {error}", file=sys.stderr)


if __name__ == "__main__":
    loss, delay, jitter = map(float, sys.argv[1:4])
    Relay(loss, delay, jitter, int(sys.argv[4]), sys.argv[5:]).run()
