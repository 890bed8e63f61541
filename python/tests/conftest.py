"""A two-link arm on a bench, and recordings of it that are made up."""

import numpy as np
import pytest

import quadverse

ARM = """<robot name="arm">
<link name="bench"/>
<link name="upper"><inertial><origin xyz="0 0 -0.15"/><mass value="0.6"/>
<inertia ixx="0.004" iyy="0.004" izz="0.0005" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="lower"><inertial><origin xyz="0 0 -0.12"/><mass value="0.4"/>
<inertia ixx="0.002" iyy="0.002" izz="0.0003" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="shoulder" type="revolute"><parent link="bench"/><child link="upper"/><origin xyz="0 0 1"/>
<axis xyz="0 1 0"/><limit lower="-9" upper="9" effort="50" velocity="50"/></joint>
<joint name="elbow" type="revolute"><parent link="upper"/><child link="lower"/><origin xyz="0 0 -0.3"/>
<axis xyz="0 1 0"/><limit lower="-9" upper="9" effort="50" velocity="50"/></joint>
</robot>"""

DESCRIPTION = 'robot = "arm.urdf"\nbase = "fixed"\n[actuator]\nkind = "pd"\nkp = 12.0\nkd = 0.4\ntau_max = 20.0\n'


@pytest.fixture
def arm():
    return ARM


def record(folder, latency, seconds=8.0):
    """Swings of an arm whose commands come ``latency`` seconds late, as a table with an encoder's noise."""
    batch = quadverse.Batch(ARM, 1, base="fixed", max_command_latency=0.05)
    batch.expand("actuator.*.command_latency")[:] = latency
    ctrl, kp, kd, qpos = (batch.bind(name) for name in ("ctrl", "kp", "kd", "qpos"))
    kp[:], kd[:] = 12.0, 0.4
    random, lines = np.random.default_rng(7), ["time,cmd_pos.shoulder,cmd_pos.elbow,pos.shoulder,pos.elbow"]
    for tick in range(int(seconds * 500)):
        time = 2e-3 * tick
        ctrl[0] = [0.6 * np.sin(2.1 * time) + 0.2 * np.sin(5.3 * time), 0.5 * np.sin(3.1 * time)]
        seen = qpos[0] + 1e-4 * random.standard_normal(2)
        lines.append(f"{time:.4f},{ctrl[0, 0]:.6f},{ctrl[0, 1]:.6f},{seen[0]:.7f},{seen[1]:.7f}")
        batch.step(2)
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "run.csv").write_text("\n".join(lines) + "\n")
    (folder / "run.toml").write_text(DESCRIPTION)
    (folder / "arm.urdf").write_text(ARM)
    return folder


@pytest.fixture(scope="session")
def late_arm(tmp_path_factory):
    return record(tmp_path_factory.mktemp("late") / "run", 0.012)
