"""A plain client of OpenIGTLink, for tests: a socket and a codec."""

import socket
import time

from sonospline import igtl


class LinkClient:
    """Sends messages in a version of the header, and keeps what comes."""

    def __init__(self, port, version=1, buffer=None):
        self.version, self.framer, self.versions = version, igtl.Framer(), []
        self.socket = socket.socket()
        if buffer is not None:
            self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, buffer)
        self.socket.connect(("127.0.0.1", port))

    def send(self, content, device="", **more):
        self.socket.sendall(igtl.encode(igtl.Message(content, device, **more), self.version))

    def next(self, seconds=10.0):
        """The next message; ConnectionError at the end of the stream, TimeoutError where none comes."""
        until = time.monotonic() + seconds
        while (found := self.framer.next()) is None:
            self.socket.settimeout(max(1e-3, until - time.monotonic()))
            data = self.socket.recv(1 << 20)
            if not data:
                raise ConnectionError("the server hung up")
            self.framer.feed(data)
        self.versions.append(found[0].version)
        return igtl.decode_body(*found)

    def wait_for(self, kind, device=None, seconds=10.0):
        """The next message of a type, and a device."""
        until = time.monotonic() + seconds
        while True:
            message = self.next(until - time.monotonic())
            if message.content.type == kind and device in (None, message.device):
                return message

    def is_hung_up_on(self, seconds=10.0):
        try:
            while True:
                self.next(seconds)
        except ConnectionError:
            return True
        except TimeoutError:
            return False

    def close(self):
        self.socket.close()

    def __enter__(self):
        return self

    def __exit__(self, *problem):
        self.close()


def eventually(condition, seconds=10.0):
    """Whether something comes true."""
    until = time.monotonic() + seconds
    while not condition():
        if time.monotonic() > until:
            return False
        time.sleep(0.005)
    return True
