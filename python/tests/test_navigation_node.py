"""The node of ``examples/go2_cone.py`` over a stand-in for ROS 2 whose messages go through UDP sockets of this machine."""

import importlib.util
import pickle
import socket
import sys
import types
from pathlib import Path

import numpy as np
import pytest

PYTHON = Path(__file__).parents[1]


def load(name, path):
    spec = importlib.util.spec_from_file_location(name, path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


class Wire:
    """A topic: what is published goes through a socket, and comes out when it is asked for."""

    def __init__(self):
        self.receiver = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.receiver.bind(("127.0.0.1", 0))
        self.receiver.setblocking(False)
        self.sender = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)

    def publish(self, message):
        # A picture is larger than a datagram.
        parts = pickle.dumps(message)
        parts = [parts[k : k + 32000] for k in range(0, len(parts), 32000)]
        for k, part in enumerate(parts):
            self.sender.sendto(pickle.dumps((k, len(parts), part)), self.receiver.getsockname())
            self.pull()

    def pull(self):
        while True:
            try:
                k, count, part = pickle.loads(self.receiver.recv(65000))
            except BlockingIOError:
                return
            self.parts = [part] if k == 0 else [*self.parts, part]
            if len(self.parts) == count:
                self.arrived = getattr(self, "arrived", []) + [pickle.loads(b"".join(self.parts))]

    def take(self):
        self.pull()
        out, self.arrived = getattr(self, "arrived", []), []
        return out


class World:
    """Topics, timers and a clock that the test moves."""

    def __init__(self):
        self.time, self.wires, self.subscribers, self.timers, self.errors = 0.0, {}, [], [], []

    def wire(self, topic):
        return self.wires.setdefault(topic, Wire())

    def run(self, seconds):
        self.time += seconds
        for topic, call in self.subscribers:
            for message in self.wire(topic).take():
                call(message)
        for call in self.timers:
            call()


def vector():
    return types.SimpleNamespace(x=0.0, y=0.0, z=0.0)


@pytest.fixture
def world(monkeypatch):
    world = World()

    class Node:
        def __init__(self, name):
            self.name = name

        def create_subscription(self, kind, topic, call, depth):
            world.subscribers.append((topic, call))

        def create_publisher(self, kind, topic, depth):
            return world.wire(topic)

        def create_timer(self, period, call):
            assert period == 0.2
            world.timers.append(call)

        def get_clock(self):
            now = types.SimpleNamespace(nanoseconds=int(world.time * 1e9))
            return types.SimpleNamespace(now=lambda: now)

        def get_logger(self):
            return types.SimpleNamespace(error=world.errors.append)

    twist = lambda: types.SimpleNamespace(linear=vector(), angular=vector())
    for name, members in {
        "rclpy": {},
        "rclpy.node": {"Node": Node},
        "geometry_msgs": {},
        "geometry_msgs.msg": {"Twist": twist},
        "nav_msgs": {},
        "nav_msgs.msg": {"Odometry": object},
        "sensor_msgs": {},
        "sensor_msgs.msg": {"Image": object},
    }.items():
        module = types.ModuleType(name)
        module.__dict__.update(members)
        monkeypatch.setitem(sys.modules, name, module)
    navigation = load("quadverse.navigation", PYTHON / "quadverse" / "navigation.py")
    monkeypatch.setitem(sys.modules, "quadverse.navigation", navigation)
    return world


class Policy:
    """Remembers what it was asked, and turns."""

    def __init__(self):
        self.asked = []

    def decide(self, frame, gravity, odometry):
        self.asked.append((frame[0, 0].tolist(), gravity, odometry))
        return np.array([0.3, 0.0, -0.5])


def image(encoding="bgr8", step=3 * 640 + 8):
    row = bytes([10, 20, 30] * 640) + bytes(step - 3 * 640)
    return types.SimpleNamespace(encoding=encoding, height=480, width=640, step=step, data=row * 480)


def odometry(x, y, yaw):
    position = types.SimpleNamespace(x=x, y=y, z=0.3)
    orientation = types.SimpleNamespace(w=np.cos(yaw / 2), x=0.0, y=0.0, z=np.sin(yaw / 2))
    pose = types.SimpleNamespace(position=position, orientation=orientation)
    return types.SimpleNamespace(pose=types.SimpleNamespace(pose=pose))


def commands(world):
    return [(t.linear.x, t.linear.y, t.angular.z) for t in world.wire("/cmd_vel").take()]


def test_it_drives_while_pictures_come_and_stands_when_they_do_not(world):
    node_file = load("go2_cone", PYTHON / "examples" / "go2_cone.py")
    policy = Policy()
    node = node_file.ConeNode(policy)
    world.run(0.2)
    assert commands(world) == [(0.0, 0.0, 0.0)] and not policy.asked
    for x in (1.0, 1.5):
        world.wire("/camera/color/image_raw").publish(image())
        world.wire("/odom").publish(odometry(x, 2.0, np.pi / 2))
        world.run(0.2)
    assert commands(world) == [(0.3, 0.0, -0.5)] * 2
    frame, gravity, since = policy.asked[1]
    assert frame == [30, 20, 10], "red first"
    assert np.allclose(gravity, (0, 0, -1)) and np.allclose(since, (0.0, -0.5, 0.0)), "in the axes of the start"
    # Odometry goes on, pictures do not: after 0.4 s it stands.
    for _ in range(3):
        world.wire("/odom").publish(odometry(1.5, 2.0, 0.0))
        world.run(0.21)
    assert commands(world) == [(0.3, 0.0, -0.5), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)]
    world.wire("/camera/color/image_raw").publish(image("mono8"))
    world.wire("/odom").publish(odometry(1.5, 2.0, 0.0))
    world.run(0.2)
    assert commands(world) == [(0.0, 0.0, 0.0)] and "mono8" in world.errors[0]
    world.time += 25.0
    world.wire("/camera/color/image_raw").publish(image())
    world.wire("/odom").publish(odometry(1.5, 2.0, 0.0))
    world.run(0.2)
    assert commands(world) == [(0.0, 0.0, 0.0)], "the time is over"
    node.publish((0.0, 0.0, 0.0))


def test_gravity_is_that_of_the_simulator(world):
    node_file = load("go2_cone", PYTHON / "examples" / "go2_cone.py")
    # Nose down by 0.2 rad: gravity has a part forwards.
    orientation = types.SimpleNamespace(w=np.cos(0.1), x=0.0, y=np.sin(0.1), z=0.0)
    (_, _, yaw), down = node_file.planar(types.SimpleNamespace(position=vector(), orientation=orientation))
    assert abs(yaw) < 1e-12 and np.allclose(down, (np.sin(0.2), 0.0, -np.cos(0.2)))


def test_a_navigator_limits_changes_and_names_bad_frames(world, monkeypatch):
    navigation = sys.modules["quadverse.navigation"]

    class Session:
        def __init__(self, *_, **__):
            pass

        def get_modelmeta(self):
            return types.SimpleNamespace(custom_metadata_map={"half_sides": "3.0 2.5"})

        def run(self, names, inputs):
            assert names == ["command", "sight", "next_memory"]
            shapes = {name: value.shape for name, value in inputs.items()}
            assert shapes == dict(frame=(1, 480, 640, 3), state=(1, 6), recall=(1, 398), memory=(1, 192))
            return np.array([[0.6, 0.0, 1.0]], np.float32), np.full((1, 32), 1.0, np.float32), inputs["memory"]

    monkeypatch.setitem(sys.modules, "onnxruntime", types.SimpleNamespace(InferenceSession=Session))
    navigator = navigation.Navigator("policy.onnx", "blue")
    assert navigator.colour.tolist() == [0.0, 1.0, 0.0]
    first = navigator.decide(np.zeros((480, 640, 3), np.uint8), (0, 0, -1), (0.0, 0.0, 0.0))
    assert first.tolist() == [0.3, 0.0, 1.0], "changes are limited"
    with pytest.raises(ValueError, match="480, 640"):
        navigator.decide(np.zeros((60, 80, 3), np.uint8), (0, 0, -1), (0.0, 0.0, 0.0))
