"""Many environments of one robot, stepped together."""

import os

import numpy as np

from . import _quadverse


class Batch(_quadverse.Batch):
    """``n`` environments of ``robot`` on ``terrain``, at rest in the zero position.

    ``robot`` is ``"go2"``, a URDF or MJCF file, or the text of one. ``terrain`` is ``"plane"`` or a GLB file.
    """

    def __new__(cls, robot, n, terrain="plane", **options):
        return super().__new__(cls, os.fspath(robot), n, os.fspath(terrain), **options)

    def __repr__(self):
        return f"Batch of {len(self)} environments, {len(self.joint_names)} joints, step {self.timestep:g} s"

    def expand(self, pattern):
        """The parameters whose names fit ``pattern``, in which ``*`` stands for text without a dot."""
        names = self.parameter_names(pattern)
        if not names:
            # An exact name that is wrong is answered with the nearest one.
            if "*" not in pattern:
                self.parameter_info(pattern)
            raise ValueError(f"parameters: expected some like {pattern!r}, found none")
        return Parameters(self, names)


class Parameters:
    """Parameters of a batch by environment and name, shape ``(n, len(names))``.

    Reading gives a new array. Only an assignment, such as ``parameters[:] = 0.1``, changes the simulator.
    """

    def __init__(self, batch, names):
        self._batch, self.names = batch, names
        self.shape = (len(batch), len(names))

    def __getitem__(self, key):
        return self._batch.read_parameters(self.names)[key]

    def __setitem__(self, key, values):
        all_values = self._batch.read_parameters(self.names)
        all_values[key] = values
        self._batch.write_parameters(self.names, all_values)

    def __array__(self, dtype=None, copy=None):
        if copy is False:
            raise ValueError("parameters are read into a new array: copy=False cannot be")
        return np.asarray(self[:], dtype=dtype)

    def __len__(self):
        return self.shape[0]

    def __repr__(self):
        return f"Parameters {', '.join(self.names)} of {self.shape[0]} environments"
