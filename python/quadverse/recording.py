"""Recordings as columns of numpy."""

import json
import os

from . import _quadverse
from ._extras import need


class Recording:
    """What a robot recorded. ``recording["position"]`` is ``(time, values)`` of shapes ``(T,)`` and ``(T, joints)``."""

    def __init__(self, native, reading=None):
        self._native = native
        # How it was opened, in the words of `open` and of the command line.
        self.reading = reading or {}

    def __getattr__(self, name):
        if name.startswith("__") or name == "_native":
            raise AttributeError(name)
        return getattr(self._native, name)

    def __getitem__(self, channel):
        return self._native.channel(channel)

    def __iter__(self):
        return iter(self._native.channels)

    def __contains__(self, channel):
        return channel in self._native.channels

    @property
    def faults(self):
        """What is wrong with the data: a list of dicts with kind, channel, time, count, detail."""
        return json.loads(self._native.faults_json())

    def to_pandas(self, channel):
        """One channel as a DataFrame over time (needs pandas)."""
        pandas = need("pandas")

        time, values = self[channel]
        joints, feet = self.joint_names, self.foot_names
        fixed = {
            "gyro": ["x", "y", "z"],
            "acceleration": ["x", "y", "z"],
            "orientation": ["w", "x", "y", "z"],
            "base_pose": ["x", "y", "z", "qw", "qx", "qy", "qz"],
            "foot_force": feet,
        }
        columns = fixed.get(channel, joints)
        return pandas.DataFrame(values, index=pandas.Index(time, name="time"), columns=columns)

    def __repr__(self):
        start, end = self.span
        return f"Recording {self.path}: {len(self.joint_names)} joints, {end - start:.2f} s, {', '.join(self.channels)}"


def open(path, *, robot=None, pose_topic=None, namespace=None):
    """Reads a bag, a table, or a dataset of another program."""
    robot = None if robot is None else os.fspath(robot)
    reading = {"robot": robot, "pose_topic": pose_topic, "namespace": namespace}
    return Recording(_quadverse.open(os.fspath(path), robot, pose_topic, namespace), reading)
