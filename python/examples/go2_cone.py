"""Drives a Go2 with ROS 2 to a coloured cone: ``python go2_cone.py out/nav/policy.onnx red``.

In: a camera of 640 x 480 that looks down by 17 degrees (/camera/color/image_raw), odometry (/odom). Out: geometry_msgs/Twist (/cmd_vel), five
times a second, which the robot's own gait follows. A picture or odometry older than 0.4 s, or an error, makes it stand still; so does its end.
It was not run on a robot: keep the remote control at hand. Needs rclpy, numpy, onnxruntime, and quadverse/navigation.py.
"""

import argparse
import math

import numpy as np
import rclpy
from geometry_msgs.msg import Twist
from nav_msgs.msg import Odometry
from rclpy.node import Node
from sensor_msgs.msg import Image

from quadverse.navigation import COLOURS, Navigator

PERIOD = 0.2
STALE = 0.4
LONGEST = 25.0


def pixels(message):
    """Red, green, blue of a message with three bytes a pixel; its rows may be padded."""
    if message.encoding not in ("rgb8", "bgr8"):
        raise ValueError(f"encoding of the picture: expected rgb8 or bgr8, found {message.encoding}")
    rows = np.frombuffer(message.data, np.uint8).reshape(message.height, message.step)
    frame = rows[:, : 3 * message.width].reshape(message.height, message.width, 3)
    return frame if message.encoding == "rgb8" else frame[..., ::-1]


def planar(pose):
    """x, y, yaw, and the direction of gravity in the base."""
    q, p = pose.orientation, pose.position
    yaw = math.atan2(2.0 * (q.w * q.z + q.x * q.y), 1.0 - 2.0 * (q.y * q.y + q.z * q.z))
    down = (2.0 * (q.w * q.y - q.x * q.z), -2.0 * (q.y * q.z + q.w * q.x), 2.0 * (q.x * q.x + q.y * q.y) - 1.0)
    return (p.x, p.y, yaw), down


class ConeNode(Node):
    def __init__(self, navigator):
        super().__init__("go2_cone")
        self.navigator, self.frame, self.pose, self.start, self.began = navigator, None, None, None, None
        self.seen_at = self.moved_at = -math.inf
        self.create_subscription(Image, "/camera/color/image_raw", self.on_image, 1)
        self.create_subscription(Odometry, "/odom", self.on_odometry, 1)
        self.commands = self.create_publisher(Twist, "/cmd_vel", 1)
        self.create_timer(PERIOD, self.decide)

    def now(self):
        return self.get_clock().now().nanoseconds * 1e-9

    def on_image(self, message):
        self.frame, self.seen_at = message, self.now()

    def on_odometry(self, message):
        self.pose, self.moved_at = planar(message.pose.pose), self.now()

    def decide(self):
        command, now = (0.0, 0.0, 0.0), self.now()
        if self.began is not None and now - self.began > LONGEST:
            pass
        elif now - min(self.seen_at, self.moved_at) < STALE:
            try:
                (x, y, yaw), down = self.pose
                if self.start is None:
                    self.start, self.began = (x, y, yaw), now
                x0, y0, yaw0 = self.start
                c, s = math.cos(yaw0), math.sin(yaw0)
                since = (c * (x - x0) + s * (y - y0), c * (y - y0) - s * (x - x0), yaw - yaw0)
                command = self.navigator.decide(pixels(self.frame), down, since)
                if not np.all(np.isfinite(command)):
                    raise ValueError(f"command: expected finite numbers, found {command}")
            except ValueError as error:
                command = (0.0, 0.0, 0.0)
                self.get_logger().error(str(error))
        self.publish(command)

    def publish(self, command):
        twist = Twist()
        twist.linear.x, twist.linear.y, twist.angular.z = (float(x) for x in command)
        self.commands.publish(twist)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("policy", help="policy.onnx of qv navigate train")
    parser.add_argument("colour", choices=COLOURS)
    arguments = parser.parse_args()
    rclpy.init()
    node = ConeNode(Navigator(arguments.policy, arguments.colour))
    try:
        rclpy.spin(node)
    except KeyboardInterrupt:
        pass
    finally:
        node.publish((0.0, 0.0, 0.0))
        node.destroy_node()
        rclpy.shutdown()


if __name__ == "__main__":
    main()
