"""The needle's force as a stream of LSL. Needs pylsl.

python lsl_bridge.py [HOST [PORT]]
"""

import json
import sys
import threading

import pylsl

from sonospline.tracking import LinkClient


def bridge(host: str = "localhost", port: int = 18944) -> LinkClient:
    """Return a client that passes forces on until it is closed: x, y, z of the reference and along the needle, N."""
    info = pylsl.StreamInfo("NeedleForce", "Force", 4, pylsl.IRREGULAR_RATE, "float32", f"sonospline-{host}-{port}")
    outlet = pylsl.StreamOutlet(info)

    def push(message):
        if message.device == "NeedleForce":
            said = json.loads(message.content.text)
            outlet.push_sample([*said["force_n"], said["axial_n"]])

    return LinkClient(host, port, push, reads=["STRING"])


if __name__ == "__main__":
    with bridge(*sys.argv[1:2], *map(int, sys.argv[2:3])):
        threading.Event().wait()
