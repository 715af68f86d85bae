"""A cable between a process and the router: TCP that can stall, be cut and be unplugged."""

from __future__ import annotations

import contextlib
import socket
import threading
from typing import Self

from client.deployment import HOST

_CHUNK = 1 << 16


class Cable:
    """Listens on a port of its own and passes every connection on to the router.

    Two threads per connection copy bytes with blocking calls, so that a receiver that does not
    read is felt by the sender as on a real link.

    Args:
        port: Where it listens.
        router_port: Where it leads to.
    """

    def __init__(self, port: int, router_port: int) -> None:
        self._router_port = router_port
        self._listener = socket.create_server((HOST, port))
        self._flows = threading.Event()
        self._flows.set()
        self._unplugged = False
        self._lock = threading.Lock()
        self._ends: set[socket.socket] = set()
        self._closed = False
        threading.Thread(target=self._accept, daemon=True).start()

    def stall(self) -> None:
        """Nothing arrives any more, on either side; connections stay open."""
        self._flows.clear()

    def resume(self) -> None:
        """What was held back arrives."""
        self._flows.set()

    def cut(self) -> None:
        """Close what is open; a new connection is possible at once."""
        with self._lock:
            ends, self._ends = self._ends, set()
        for end in ends:
            _close(end)

    def unplug(self) -> None:
        """Close what is open and let nothing new through until it is plugged in again."""
        self._unplugged = True
        self.cut()

    def plug_in(self) -> None:
        """Let connections through again."""
        self._unplugged = False

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Take it away."""
        self._closed = True
        _close(self._listener)
        self.resume()
        self.unplug()

    def _accept(self) -> None:
        while not self._closed:
            try:
                near, _ = self._listener.accept()
            except OSError:
                return
            far = self._connect()
            if far is None:
                _close(near)
                continue
            for end in (near, far):
                end.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            with self._lock:
                self._ends |= {near, far}
            for source, sink in ((near, far), (far, near)):
                threading.Thread(target=self._copy, args=(source, sink), daemon=True).start()

    def _connect(self) -> socket.socket | None:
        if self._unplugged:
            return None
        try:
            return socket.create_connection((HOST, self._router_port))
        except OSError:
            # Seen from the process: there is no router.
            return None

    def _copy(self, source: socket.socket, sink: socket.socket) -> None:
        with contextlib.suppress(OSError):
            while data := source.recv(_CHUNK):
                self._flows.wait()
                sink.sendall(data)
        # Held back like data: an end that closes behind a stalled link is not seen either.
        self._flows.wait()
        with self._lock:
            self._ends -= {source, sink}
        _close(source)
        _close(sink)


def _close(end: socket.socket) -> None:
    # Without the shutdown a thread that is blocked in the socket would stay so.
    with contextlib.suppress(OSError):
        end.shutdown(socket.SHUT_RDWR)
    end.close()
