"""What cameras see of a scene of Gaussians."""

import json
import os
from pathlib import Path

import numpy as np

from . import _quadverse
from ._quadverse import Cloud


def open_cloud(path):
    """Reads a scene of Gaussians: PLY, SPZ, glTF or .splat."""
    return _quadverse.open_cloud(os.fspath(path))


def cloud(means, log_scales, rotations, opacity_logits, sh):
    """A scene of arrays: (N, 3), (N, 3), quaternions w, x, y, z (N, 4), (N,), and (N, 3) or (N, (degree + 1)², 3)."""

    def floats(values):
        return np.ascontiguousarray(values, np.float32)

    return Cloud(floats(means), floats(log_scales), floats(rotations), floats(opacity_logits), floats(sh).reshape(-1, 3))


def render(scene, cameras, *, background=None):
    """What cameras see: a list of dicts with ``name``, ``colour`` (height, width, 3), ``alpha`` and ``depth`` [m] (height, width).

    ``scene`` is a ``Cloud`` or a file of one. ``cameras`` is a JSON file of ours, or a dict or list of dicts with width, height, fx,
    position, rotation (w, x, y, z; x right, y down, z forward), and where need be fy, cx, cy, name, distortion.
    """
    if not isinstance(scene, Cloud):
        scene = open_cloud(scene)
    if isinstance(cameras, (str, os.PathLike)):
        text = Path(cameras).read_text()
    else:
        several = [cameras] if isinstance(cameras, dict) else list(cameras)
        named = [{"name": str(index), **_plain(one)} for index, one in enumerate(several)]
        text = json.dumps({"format": "qv-cameras/1", "cameras": named})
    return _quadverse.render(scene, text, None if background is None else tuple(map(float, background)))


def _plain(camera):
    """Arrays of numpy as lists."""
    return {key: value.tolist() if hasattr(value, "tolist") else value for key, value in camera.items()}
