"""Gaussians that cameras see."""

import json

import numpy as np
import pytest

import quadverse

CAMERA = {"width": 32, "height": 24, "fx": 30.0, "position": [0, 0, 0], "rotation": [1, 0, 0, 0]}


def ball(distance):
    """One red Gaussian in front of a camera that looks along z."""
    return quadverse.cloud([[0, 0, distance]], [[-1.5] * 3], [[1, 0, 0, 0]], [4.0], [[1.7, -1.7, -1.7]])


def test_a_ball_is_where_it_is():
    image = quadverse.render(ball(2.0), CAMERA)[0]
    assert image["colour"].shape == (24, 32, 3) and image["depth"].shape == image["alpha"].shape == (24, 32)
    middle, corner = image["colour"][12, 16], image["colour"][0, 0]
    assert middle[0] > 0.8 and middle[1] < 0.2 and not corner.any()
    assert image["depth"][12, 16] == pytest.approx(2.0, abs=1e-3)


def test_cameras_are_dicts_arrays_or_a_file(tmp_path):
    beside = {**CAMERA, "name": "beside", "position": np.array([5.0, 0.0, 0.0])}
    images = quadverse.render(ball(2.0), [CAMERA, beside], background=[0, 0, 1])
    assert [image["name"] for image in images] == ["0", "beside"]
    assert images[1]["alpha"].max() == 0 and (images[1]["colour"] == [0, 0, 1]).all()
    file = tmp_path / "cameras.json"
    file.write_text(json.dumps({"format": "qv-cameras/1", "cameras": [{**CAMERA, "name": "a"}]}))
    again = quadverse.render(ball(2.0), file, background=[0, 0, 1])
    assert np.array_equal(again[0]["colour"], images[0]["colour"])


def test_what_is_off_is_named(tmp_path):
    with pytest.raises(OSError, match="nowhere.ply"):
        quadverse.open_cloud(tmp_path / "nowhere.ply")
    with pytest.raises(ValueError, match="fx"):
        quadverse.render(ball(1.0), {key: value for key, value in CAMERA.items() if key != "fx"})
    with pytest.raises(ValueError, match="rotations"):
        quadverse.cloud([[0, 0, 1]], [[0, 0, 0]], [[1, 0, 0]], [0], [[0, 0, 0]])
    with pytest.raises(ValueError, match="sh"):
        quadverse.cloud([[0, 0, 1]], [[0, 0, 0]], [[1, 0, 0, 0]], [0], [[0, 0, 0]] * 2)
