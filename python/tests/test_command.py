"""The command line in the wheel: called as a program and from Python."""

import subprocess
import sys

import pytest

import quadverse
from quadverse.command import _options, program


def test_the_wheel_brings_the_program(late_arm):
    found = subprocess.run([program(), "--version"], capture_output=True, text=True, check=True).stdout
    assert found.split() == ["qv", quadverse.__version__]
    as_module = subprocess.run([sys.executable, "-m", "quadverse", "--version"], capture_output=True, text=True)
    assert as_module.stdout == found and as_module.returncode == 0
    assert "shoulder" in quadverse.qv("inspect", late_arm, verbose=False)


def test_a_failure_is_what_the_command_said(tmp_path, capsys):
    with pytest.raises(quadverse.QvError, match="nothing.mcap"):
        quadverse.qv("inspect", tmp_path / "nothing.mcap")
    assert "nothing.mcap" in capsys.readouterr().err


def test_arguments_become_words():
    assert _options(max_seconds=3, robust=True, resume=False, seed=None, vx=[-1, 1]) == [
        "--max-seconds",
        "3",
        "--robust",
        "--vx=-1,1",
    ]


def test_a_policy_is_trained_and_trained_on(tmp_path):
    walk = quadverse.train_walk(tmp_path / "walk", iterations=20, robots=32, seed=3, verbose=False)
    assert walk.onnx.is_file() and len(walk.metrics) == 20
    assert {"velocity_error", "turning_error", "fell"} <= set(walk.score)
    assert len(walk.to_pandas()) == 20 and "<iframe" in walk._repr_html_()
    again = quadverse.train_walk(tmp_path / "walk", iterations=21, resume=True, verbose=False)
    assert len(again.metrics) == 21
    with pytest.raises(quadverse.QvError, match="nobody.toml"):
        quadverse.train_walk(tmp_path / "other", robot="nobody.toml", verbose=False)
    # Tuning begins with what any number of iterations left; here it has no recordings.
    with pytest.raises(quadverse.QvError, match="recording"):
        quadverse.tune(tmp_path / "log", walk, tmp_path / "tuned", verbose=False)


@pytest.mark.slow
def test_a_policy_is_tuned(tmp_path):
    walk = quadverse.train_walk(tmp_path / "walk", iterations=100, robots=32, seed=3, verbose=False)
    quadverse.qv("walk", "record", walk.onnx, "--minutes", 4, "--walk", 10, "--out", tmp_path / "log", verbose=False)
    tuned = quadverse.tune(tmp_path / "log", walk, tmp_path / "tuned", iterations=4)
    assert tuned.onnx.is_file() and tuned.fields["candidates"] and repr(tuned).startswith("Tuned: ")
    # The simulator as it is, and what was fitted: the fit is nearer to the robot.
    errors = [candidate["held_out"]["error"] for candidate in tuned.fields["candidates"]]
    assert min(errors[1:]) < 0.5 * errors[0]


def test_friction_of_a_ground(tmp_path):
    quadverse.qv("fixture", "--out", tmp_path, verbose=False)
    recording = quadverse.open(tmp_path / "run.mcap")
    found = quadverse.contact(recording, tmp_path / "terrain.glb", parameters={"actuator.*.command_latency": 0.008})
    assert found.frictions and all(0.05 < friction < 2 for friction in found.frictions.values())
    assert set(found.to_pandas()["label"]) == set(found.frictions) and "<html" in found.html
    found.save(tmp_path / "saved")
    assert (tmp_path / "saved/calibrated.toml").is_file() and repr(found).startswith("Contact: ")
    with pytest.raises(quadverse.QvError, match="no_such.glb"):
        quadverse.contact(recording, tmp_path / "no_such.glb")
