"""Batches: arrays, parameters, snapshots, contacts, sensors, added torques, threads."""

import subprocess
import sys
import threading

import numpy as np
import pytest

import quadverse


def standing(n, **options):
    batch = quadverse.Batch("go2", n, **options)
    qpos = np.zeros((n, batch.nq))
    qpos[:, 2], qpos[:, 3] = 0.34, 1.0
    qpos[:, 7:] = [0.1, 0.8, -1.5, -0.1, 0.8, -1.5, 0.1, 1.0, -1.5, -0.1, 1.0, -1.5]
    batch.set_state(qpos)
    batch.bind("ctrl")[:] = qpos[:, 7:]
    batch.bind("kp")[:], batch.bind("kd")[:] = 40.0, 1.0
    return batch


def test_import_needs_neither_numpy_nor_the_native_part():
    code = "import sys, quadverse; print([m for m in ('numpy', 'quadverse._quadverse') if m in sys.modules])"
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert found.stdout.strip() == "[]"


def test_bound_arrays_are_filled_by_every_step():
    batch = standing(3)
    qpos, force = batch.bind("qpos"), batch.bind("geom_force")
    assert qpos.shape == (3, 19) and qpos.dtype == np.float32
    before = qpos.copy()
    batch.step(300)
    assert not np.array_equal(qpos, before)
    assert 0.25 < qpos[0, 2] < 0.36
    # Fifteen kilograms stand on the ground.
    assert 100 < force.reshape(3, -1, 3)[0, :, 2].sum() < 200
    again = batch.bind("qpos")
    assert np.shares_memory(qpos, again)


def test_outputs_cannot_be_written_and_outlive_the_batch():
    batch = standing(2)
    qpos = batch.bind("qpos")
    with pytest.raises(ValueError, match="read-only"):
        qpos[0, 0] = 1.0
    batch.step()
    height = qpos[0, 2]
    del batch
    assert qpos[0, 2] == height


def test_outputs_go_to_other_libraries_without_a_copy():
    batch = standing(2)
    shared = np.from_dlpack(batch.bind("qpos", writable=True))
    assert np.shares_memory(shared, batch.bind("qpos"))
    before = shared.copy()
    batch.step(50)
    assert not np.array_equal(shared, before)
    ctrl = np.from_dlpack(batch.bind("ctrl"))
    assert np.shares_memory(ctrl, batch.bind("ctrl"))


def test_parameters_by_name_and_environment(arm):
    batch = quadverse.Batch(arm, 2, base="fixed")
    friction = batch.expand("joint.*.viscous_friction")
    assert friction.names == ["joint.shoulder.viscous_friction", "joint.elbow.viscous_friction"]
    friction[1] = 0.5
    assert np.array_equal(friction[:], [[0.0, 0.0], [0.5, 0.5]])
    batch.set_state(np.ones((2, 2)))
    qvel = batch.bind("qvel")
    batch.step(200)
    assert abs(qvel[0]).max() > 2 * abs(qvel[1]).max()
    batch.reset_parameters(1)
    assert not np.any(friction[:])
    with pytest.raises(ValueError, match="joint.elbow.viscous_friction"):
        batch.expand("joint.elbow.viscous_frictoin")
    with pytest.raises(ValueError, match="at least 0"):
        friction[:] = -1.0


def test_a_snapshot_gives_the_same_bits_again():
    batch = standing(5)
    qpos, snapshot = batch.bind("qpos"), batch.snapshot()
    batch.step(50)
    first = qpos.copy()
    batch.restore(snapshot)
    assert not np.array_equal(qpos, first)
    batch.step(50)
    assert np.array_equal(qpos, first)
    with pytest.raises(ValueError):
        standing(4).restore(snapshot)


def test_contacts_and_imu_of_a_robot_that_stands():
    batch = standing(2, keep_contacts=True)
    acceleration, orientation = batch.bind("accelerometer"), batch.bind("imu_orientation")
    batch.step(1500)
    contacts = batch.contacts(1)
    assert contacts["point"].shape == contacts["force"].shape == (len(contacts["geom"]), 3)
    assert len(contacts["geom"]) >= 4 and contacts["normal"][0] == pytest.approx([0, 0, 1])
    assert contacts["force"][:, 2].sum() == pytest.approx(9.81 * 15.2, rel=0.1)
    assert np.linalg.norm(acceleration[0]) == pytest.approx(9.81, abs=0.1)
    assert np.linalg.norm(orientation, axis=1) == pytest.approx([1, 1], abs=1e-5)
    with pytest.raises(ValueError, match="keep_contacts"):
        standing(1).contacts(0)


def test_added_torques_move_a_joint(arm):
    batch = quadverse.Batch(arm, 2, base="fixed")
    batch.bind("added_torque")[1, 1] = 0.5
    qpos = batch.bind("qpos")
    batch.step(100)
    assert qpos[1, 1] > 0.05 and abs(qpos[0, 1]) < 1e-6


def test_a_step_lets_other_threads_work():
    batch, turns, done = standing(256), [], threading.Event()

    def count():
        while not done.is_set():
            turns.append(1)
            done.wait(0.0005)

    thread = threading.Thread(target=count)
    thread.start()
    # A fast machine takes few steps in less than a turn: as many as take long enough.
    for steps in (100, 400, 1600, 6400):
        before = len(turns)
        batch.step(steps)
        during = len(turns) - before
        if during >= 3:
            break
    done.set()
    thread.join()
    assert during >= 3


def test_bad_input_is_named(tmp_path, arm):
    with pytest.raises(KeyError, match="qpos"):
        standing(1).bind("qposs")
    with pytest.raises(ValueError, match=r"\(2, 2\)"):
        quadverse.Batch(arm, 2, base="fixed").set_state(np.zeros((1, 2)))
    with pytest.raises(OSError, match="nowhere.urdf"):
        quadverse.Batch(tmp_path / "nowhere.urdf", 1)
    with pytest.raises(ValueError, match="at least 1"):
        quadverse.Batch("go2", 0)
    with pytest.raises(ValueError, match="finite"):
        batch = standing(1)
        batch.bind("ctrl")[:] = np.nan
        batch.step()
