"""Rude clients of OpenIGTLink: they vanish within messages, send garbage and headers that lie."""

import random
import socket
import time

import numpy as np

from sonospline import igtl

SOUND = [
    igtl.Message(igtl.Transform(np.eye(4)), "NeedleToReference", 1),
    igtl.Message(igtl.Status(), "me", 1),
    igtl.Message(igtl.String("x" * 40), "CMD_1", 1),
    igtl.Message(igtl.Image.of(np.zeros((1, 40, 40), np.uint8), np.eye(4)), "Image", 1),
    igtl.Message(igtl.Get("TRANSFORM"), "", 1),
]


def fuzzed(chance):
    """A message with a few bytes of its header changed, or its body cut or grown, in any version."""
    data = bytearray(igtl.encode(chance.choice(SOUND), chance.choice((1, 2, 3))))
    for _ in range(chance.randint(1, 4)):
        data[chance.randrange(58)] = chance.randrange(256)
    if chance.random() < 0.3:
        data = data[: chance.randrange(len(data))] if chance.random() < 0.5 else data + chance.randbytes(50)
    return bytes(data)


def rude_visit(port, chance):
    """One visit: some sound messages, some that are not, and an end at any byte; how many messages were sent."""
    sent = 0
    with socket.socket() as client:
        client.settimeout(2.0)
        client.connect(("127.0.0.1", port))
        try:
            for _ in range(chance.randint(1, 40)):
                kind = chance.random()
                if kind < 0.6:
                    client.sendall(fuzzed(chance))
                elif kind < 0.8:
                    client.sendall(igtl.encode(chance.choice(SOUND), 2))
                else:
                    client.sendall(chance.randbytes(chance.randint(1, 2000)))
                sent += 1
            if chance.random() < 0.5:
                client.recv(1000)
            if chance.random() < 0.5:  # gone without a word
                client.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, b"\1\0\0\0\0\0\0\0")
        except OSError:  # it was hung up on, as it deserves
            pass
    return sent


def be_rude(port, seconds, seed, headers=None):
    """Visits for so many seconds, and until so many messages were sent; how many they were."""
    chance, sent, until = random.Random(seed), 0, time.monotonic() + seconds
    while time.monotonic() < until or (headers is not None and sent < headers):
        try:
            sent += rude_visit(port, chance)
        except OSError:  # no place free for the moment
            time.sleep(0.01)
    return sent
