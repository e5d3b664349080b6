"""Poses of a link as messages of ROS 2. Needs rclpy: with ROS 2, or ros-rclpy[fastrtps] and ros-geometry-msgs of PyPI.

python ros2_bridge.py
"""

import rclpy
from geometry_msgs.msg import PoseStamped
from rclpy.node import Node
from scipy.spatial.transform import Rotation

from sonospline.tracking import LinkClient

NAMES = ("NeedleTipToReference", "ProbeToReference", "TargetToReference")


class Bridge(Node):
    """Publishes each pose under its name, in metres, as ROS counts."""

    def __init__(self):
        super().__init__("sonospline")
        self.poses = {name: self.create_publisher(PoseStamped, name, 10) for name in NAMES}

    def publish(self, message):
        """Pass a message of the link on."""
        if message.device in self.poses:
            pose, matrix = PoseStamped(), message.content.matrix
            pose.header.frame_id, pose.header.stamp = "Reference", self.get_clock().now().to_msg()
            place, turn = pose.pose.position, pose.pose.orientation
            place.x, place.y, place.z = (1e-3 * matrix[:3, 3]).tolist()
            turn.x, turn.y, turn.z, turn.w = Rotation.from_matrix(matrix[:3, :3]).as_quat().tolist()
            self.poses[message.device].publish(pose)


if __name__ == "__main__":
    rclpy.init()
    node = Bridge()
    with LinkClient("localhost", 18944, node.publish, reads=["TRANSFORM"]):
        rclpy.spin(node)
