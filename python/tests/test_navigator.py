"""The policy on a robot: ``quadverse.navigation.Navigator`` over a stand-in for onnxruntime."""

import sys
import types

import numpy as np
import pytest

from quadverse import navigation


def test_a_navigator_limits_changes_and_names_bad_frames(monkeypatch):

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
