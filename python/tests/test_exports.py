"""What `qv diagnose` exports for MuJoCo, replayed there: an arm with each effect is recorded, diagnosed, and simulated with the exported file.

`cargo xtask python --mujoco -- -k exports -s` prints a row for each effect: effect, cause that was found, error before [mrad], shares that the corrections
remove here and in MuJoCo, and their ratio.
"""

import re
import tomllib

import numpy as np
import pytest

import quadverse
from conftest import ARM, DESCRIPTION

mujoco = pytest.importorskip("mujoco", reason="MuJoCo is installed by `cargo xtask python --mujoco`")

STEP = 1e-3  # s
SECONDS = 8.0
GAINS = 12.0, 0.4  # N m/rad, N m s/rad
NOISE = 1e-4  # rad, of the encoders
JOINTS = "shoulder", "elbow"
#: Least share of the error that is removed in MuJoCo, as a part of that in our simulator.
LEAST = 0.9

#: Effects that MJCF can express: parameters of the recorded arm.
EFFECTS = {
    "command_latency": {"actuator.*.command_latency": 0.012},
    "joint_armature": {"joint.*.armature": 0.02},
    "joint_viscous_friction": {"joint.*.viscous_friction": 0.2},
    "joint_coulomb_friction": {"joint.*.coulomb_friction": 0.2},
    "motor_strength": {"actuator.*.strength": 0.7},
    "motor_gain_kp": {"actuator.*.kp_scale": 0.8},
    "motor_gain_kd": {"actuator.*.kd_scale": 0.5},
    "torque_limit": {"actuator.*.torque_limit": 2.5},
    "quadratic_drag": {"joint.*.quadratic_drag": 0.08},
    "joint_spring": {"joint.*.spring_stiffness": 1.0},
    "link_inertia": {"link.lower.inertia_scale": 4.0},
    # MJCF has no such spring; at these motions it is diagnosed as a weaker motor, which MJCF has.
    "series_compliance": {"actuator.*.series_compliance": 0.02},
}
#: Effects that it cannot express; the exported file says what to do instead.
OTHERS = {
    "actuator_lag": {"actuator.*.lag": 0.015},
    "constant_torque": {"joint.*.constant_torque": 0.3},
    "encoder_bias": {"sensor.*.encoder_bias": 0.03},
    "backlash": {"actuator.*.backlash": 0.03},
}


def commands():
    time = STEP * np.arange(int(SECONDS / STEP))
    shoulder = 0.6 * np.sin(3.1 * time) + 0.2 * np.sin(9.3 * time)
    return np.column_stack([shoulder, 0.5 * np.sin(5.1 * time) + 0.15 * np.sin(13.0 * time)])


def ours(parameters):
    """Joint angles that the encoders of our simulator see before each step, shape (ticks, 2)."""
    batch = quadverse.Batch(ARM, 1, base="fixed", timestep=STEP, max_command_latency=0.05)
    for pattern, value in parameters.items():
        batch.expand(pattern)[:] = value
    bias = np.array(batch.expand("sensor.*.encoder_bias")).reshape(len(JOINTS))
    ctrl, kp, kd, qpos = (batch.bind(name) for name in ("ctrl", "kp", "kd", "qpos"))
    kp[:], kd[:] = GAINS
    seen = []
    for row in commands():
        ctrl[0] = row
        seen.append(qpos[0] + bias)
        batch.step(1)
    return np.array(seen, float)


def attributes(fragment, joint, element):
    """Whether a joint has a class, and whether that class has an element."""
    found = re.search(rf'<default class="calibrated_{joint}">(.*?)</default>', fragment, re.DOTALL)
    return found is not None, found is not None and f"<{element}" in found[1]


def inertial(exported, body, own):
    """The mass properties that a file says to paste into a body, or its own."""
    found = re.search(rf'in <body name="{body}">.*?(<inertial .*?/>)', exported)
    return found[1] if found else own


def model(exported):
    """The arm as MJCF of a user who follows what the exported file says."""
    kp, kd = GAINS
    joints, motors = {}, ""
    for joint in JOINTS:
        has_class, has_motor = attributes(exported, joint, "position")
        of_class = f'class="calibrated_{joint}"' if has_class else ""
        gains = "" if has_motor else f'kp="{kp}" kv="{kd}"'
        joints[joint] = f'<joint name="{joint}" axis="0 1 0" {of_class}/>'
        motors += f'<position joint="{joint}" {gains} {of_class}/>'
    upper = inertial(exported, "upper", '<inertial mass="0.6" pos="0 0 -0.15" diaginertia="0.004 0.004 0.0005"/>')
    lower = inertial(exported, "lower", '<inertial mass="0.4" pos="0 0 -0.12" diaginertia="0.002 0.002 0.0003"/>')
    include = '<include file="mjcf_fragment.xml"/>' if "<mujocoinclude>" in exported else ""
    return f"""<mujoco>{include}<option timestep="{STEP}" integrator="implicitfast"/><worldbody>
        <body name="upper" pos="0 0 1">{joints["shoulder"]}{upper}
        <body name="lower" pos="0 0 -0.3">{joints["elbow"]}{lower}</body></body></worldbody>
        <actuator>{motors}</actuator></mujoco>"""


def theirs(exported):
    """Joint angles in MuJoCo before each step, with what a file exports; the nominal arm for an empty text."""
    loaded = mujoco.MjModel.from_xml_string(model(exported), {FRAGMENT: exported.encode()})
    data, seen = mujoco.MjData(loaded), []
    for row in commands():
        data.ctrl[:] = row
        seen.append(data.qpos.copy())
        mujoco.mj_step(loaded, data)
    return np.array(seen)


FRAGMENT = "mjcf_fragment.xml"  # what MuJoCo includes
BY_HAND = "mjcf_by_hand.txt"  # in its place, where an include changes nothing
NOMINAL = ""


def rms(a, b):
    return float(np.sqrt(np.mean((a - b) ** 2)))


def diagnose(folder, parameters):
    """The recorded angles, the corrections, and the files of a diagnosis."""
    recorded = ours(parameters)
    recorded += NOISE * np.random.default_rng(11).standard_normal(recorded.shape)
    lines = ["time,cmd_pos.shoulder,cmd_pos.elbow,pos.shoulder,pos.elbow"]
    for tick, (command, angle) in enumerate(zip(commands(), recorded)):
        lines.append(",".join(f"{x:.7f}" for x in (STEP * tick, *command, *angle)))
    run = folder / "run"
    run.mkdir()
    (run / "run.csv").write_text("\n".join(lines) + "\n")
    (run / "run.toml").write_text(DESCRIPTION)
    (run / "arm.urdf").write_text(ARM)
    quadverse.qv("diagnose", run, "--out", folder / "why", verbose=False)
    files = {path.name: path.read_text() for path in (folder / "why").iterdir() if path.is_file()}
    calibrated = tomllib.loads(files["calibrated.toml"]).get("parameters", {})
    return recorded, calibrated, files


def read_exported(files):
    """What is exported for MuJoCo: one file of the two, never both."""
    assert (FRAGMENT in files) != (BY_HAND in files), sorted(files)
    return files.get(FRAGMENT) or files[BY_HAND]


def stated(exported, parameter, value):
    """Whether the file names a parameter, with its value, among what MJCF cannot express."""
    line = re.search(rf"- {parameter.rsplit('.', 1)[-1]}: (.*)", exported)
    numbers = [float(x) for x in re.findall(r"-?\d[\d.]*(?:e-?\d+)?", line[1])] if line else []
    return any(np.isclose(x, value, rtol=1e-4) for x in numbers)


def print_row(effect, files, before, here, there):
    cause = re.search(r'"effect": "(\w+)"', files["report.json"])
    ratio = f"{there / here:.2f}" if there > 0.005 else "not expressed"
    print(f"\n| {effect} | {cause[1] if cause else 'none'} | {1e3 * before:.1f} | {here:.3f} | {there:.3f} | {ratio} |")


def shares(exported, recorded, calibrated):
    """Error before, and the shares of it that the corrections remove here and in MuJoCo."""
    assert calibrated, "the diagnosis corrects nothing"
    before, after = rms(ours({}), recorded), rms(ours(calibrated), recorded)
    assert before > 10 * NOISE, "the effect makes no difference"
    before_there, after_there = rms(theirs(NOMINAL), recorded), rms(theirs(exported), recorded)
    return before, 1 - after / before, 1 - after_there / before_there


def test_the_nominal_arms_are_the_same():
    assert rms(ours({}), theirs(NOMINAL)) < 1e-3


def test_an_arm_without_an_effect_gets_no_file(tmp_path):
    _, calibrated, files = diagnose(tmp_path, {})
    assert not calibrated and FRAGMENT not in files and BY_HAND not in files, sorted(files)


@pytest.mark.parametrize("effect", EFFECTS)
def test_mujoco_moves_as_the_recorded_arm(effect, tmp_path):
    recorded, calibrated, files = diagnose(tmp_path, EFFECTS[effect])
    exported = read_exported(files)
    before, here, there = shares(exported, recorded, calibrated)
    print_row(effect, files, before, here, there)
    assert rms(theirs(exported), theirs(NOMINAL)) > 10 * NOISE, "the file changes nothing"
    assert here > 0.5 and there >= LEAST * here, f"{effect}: {there:.3f} in MuJoCo, {here:.3f} here\n{exported}"
    assert not any(stated(exported, *item) for item in calibrated.items()), "what is expressed is not refused, too"


#: Of a play of 30 mrad at these motions the diagnosis corrects nothing, so that there is nothing to export.
NOT_FOUND = pytest.mark.xfail(raises=AssertionError, strict=True, reason="the diagnosis corrects nothing")


@pytest.mark.parametrize("effect", [pytest.param(e, marks=NOT_FOUND) if e == "backlash" else e for e in OTHERS])
def test_what_mjcf_cannot_express_is_said_in_the_file(effect, tmp_path):
    recorded, calibrated, files = diagnose(tmp_path, OTHERS[effect])
    exported = read_exported(files)
    before, here, there = shares(exported, recorded, calibrated)
    print_row(effect, files, before, here, there)
    assert here > 0.5, f"{effect}: {here:.3f} here"
    named = {parameter for parameter, value in calibrated.items() if stated(exported, parameter, value)}
    assert named, f"no correction is named with its value:\n{exported}"
    # A fragment has to move the arm; what it cannot say is named beside that.
    moved = rms(theirs(exported), theirs(NOMINAL))
    assert (moved > 10 * NOISE) == (FRAGMENT in files), f"{moved} rad"
    if FRAGMENT not in files:
        assert named == set(calibrated), f"not named: {set(calibrated) - named}\n{exported}"
