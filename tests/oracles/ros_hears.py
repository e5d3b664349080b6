"""What a node of ROS 2 hears of a pose that the bridge of the docs passes on: run by a Python that has rclpy."""

import importlib.util
import json
import sys
import time

import numpy as np
import rclpy
from geometry_msgs.msg import PoseStamped

from sonospline import igtl
from sonospline.link import LinkServer
from sonospline.tracking import LinkClient

bridge_file, *rows = sys.argv[1:]
spec = importlib.util.spec_from_file_location("ros2_bridge", bridge_file)
program = importlib.util.module_from_spec(spec)
spec.loader.exec_module(program)

rclpy.init()
heard = []
listener = rclpy.create_node("listener")
listener.create_subscription(PoseStamped, "NeedleTipToReference", heard.append, 10)
bridge = program.Bridge()
pose = np.array(rows, float).reshape(4, 4)
with LinkServer(port=0) as server, LinkClient("127.0.0.1", server.port, bridge.publish, reads=["TRANSFORM"]):
    until = time.monotonic() + 30
    while not heard and time.monotonic() < until:
        server.publish(igtl.Message(igtl.Transform(pose), "NeedleTipToReference", igtl.now()))
        rclpy.spin_once(listener, timeout_sec=0.1)
said = heard[0]
place, turn = said.pose.position, said.pose.orientation
sys.stdout.write(
    json.dumps({"frame": said.header.frame_id, "place": [place.x, place.y, place.z],
                "turn": [turn.x, turn.y, turn.z, turn.w]})
)  # fmt: skip
bridge.destroy_node()
listener.destroy_node()
rclpy.shutdown()
