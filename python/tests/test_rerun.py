"""Rerun's converter reads what `qv replay` writes, as it is."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

import quadverse

pytest.importorskip("rerun", reason="rerun is installed by `cargo xtask python --rerun`")


def test_a_replay_opens_in_rerun(tmp_path):
    quadverse.qv("fixture", "--out", str(tmp_path / "walk"), verbose=False)
    quadverse.qv("replay", str(tmp_path / "walk"), "--out", str(tmp_path / "out"), verbose=False)
    rerun = Path(sys.executable).parent / ("rerun.exe" if os.name == "nt" else "rerun")
    converted = tmp_path / "replay.rrd"
    words = [str(rerun), "mcap", "convert", str(tmp_path / "out/replay.mcap"), "-o", str(converted)]
    ran = subprocess.run(words, capture_output=True, text=True)
    assert ran.returncode == 0, ran.stderr[-3000:]
    told = subprocess.run([str(rerun), "rrd", "print", str(converted)], capture_output=True, text=True)
    assert told.returncode == 0, told.stderr[-3000:]
    for entity in ["/tf", "/recorded/joint_states", "/simulated/base_pose", "/recorded/foot_forces", "/error/windows"]:
        assert f" {entity} " in told.stdout, told.stdout[-3000:]
