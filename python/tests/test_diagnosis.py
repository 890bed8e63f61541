"""A recorded arm whose commands come late: opened, replayed, diagnosed."""

import os
import signal
import threading
import time

import numpy as np
import pytest

import quadverse


def test_a_recording_has_columns(late_arm):
    recording = quadverse.open(late_arm)
    assert recording.joint_names == ["shoulder", "elbow"] and recording.base == "fixed"
    time, position = recording["position"]
    assert position.shape == (len(time), 2) and len(time) == 4000
    assert "command.position" in recording and "gyro" not in recording
    assert recording.lost == [] and isinstance(recording.faults, list)
    with pytest.raises(KeyError, match="position"):
        recording["gyro"]
    frame = recording.to_pandas("position")
    assert list(frame.columns) == ["shoulder", "elbow"]


def test_what_is_no_recording_is_named(tmp_path):
    with pytest.raises(OSError, match="nothing.mcap"):
        quadverse.open(tmp_path / "nothing.mcap")


def test_replay_is_closer_with_the_latency(late_arm):
    recording = quadverse.open(late_arm)

    def error(**options):
        replay = quadverse.replay(recording, **options)
        assert replay.sentence and "<html" in replay.html
        difference = replay.simulated["position"] - replay.recorded["position"]
        return np.sqrt(np.nanmean(difference**2))

    assert error(parameters={"actuator.*.command_latency": 0.012}) < 0.2 * error()


def test_the_latency_is_accused(late_arm, tmp_path):
    report = quadverse.diagnose(late_arm)
    assert report.causes[0]["effect"] == "command_latency"
    found = report.causes[0]["parameters"][0]
    assert found["value"] == pytest.approx(0.012, abs=0.002)
    assert "command_latency" in report._repr_html_() and "<html" in report.html
    assert report.to_pandas()["effect"][0] == "command_latency"
    assert any("command_latency" in name for name in report.calibrated)
    report.save(tmp_path / "out")
    assert {"report.json", "report.html", "calibrated.toml"} <= {f.name for f in (tmp_path / "out").iterdir()}
    assert repr(report) == f"Report: {report.sentence}"
    with pytest.raises(ValueError, match="no_such_effect"):
        quadverse.diagnose(late_arm, without=["no_such_effect"])


def test_stages_are_told_and_what_is_raised_ends_it(late_arm):
    class Enough(Exception):
        pass

    seen = []

    def progress(*stage):
        seen.append(stage)
        raise Enough

    with pytest.raises(Enough):
        quadverse.diagnose(late_arm, progress=progress)
    stage, stages, name, share = seen[0]
    assert stage == 1 and stages > 1 and name and 0 <= share < 1


@pytest.mark.skipif(os.name == "nt", reason="signals are sent in another way there")
def test_an_interrupt_ends_a_diagnosis(late_arm):
    recording = quadverse.open(late_arm)
    # A parent that works in the background may have had it ignored.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    threading.Timer(0.3, os.kill, [os.getpid(), signal.SIGINT]).start()
    begun = time.perf_counter()
    with pytest.raises(KeyboardInterrupt):
        quadverse.diagnose([recording] * 4)
    # The stage that it is in goes on for itself; the caller has its prompt again.
    assert time.perf_counter() - begun < 2.0
