"""Fleets: planned and gathered from Python, and on a Ray cluster that loses workers and machines."""

import json
import os
import signal
import subprocess
import time
from pathlib import Path

import pytest

import quadverse
from quadverse.command import program

fleet = quadverse.fleet


def laboratory(root, parts):
    """Short recordings of an arm, each with what its rehearsal is to do."""
    from conftest import ARM, DESCRIPTION

    for number, part in enumerate(parts):
        folder = root / "lab" / f"run{number:02}"
        folder.mkdir(parents=True)
        rows = [f"{0.01 * k:.2f},0.1,0.1,{0.1 + 1e-4 * number},0.1" for k in range(50)]
        (folder / "run.csv").write_text(
            "\n".join(["time,cmd_pos.shoulder,cmd_pos.elbow,pos.shoulder,pos.elbow", *rows]) + "\n"
        )
        (folder / "run.toml").write_text(DESCRIPTION)
        (folder / "arm.urdf").write_text(ARM)
        (folder / "rehearse.json").write_text(json.dumps(part))
    return root / "lab"


def starts(folder):
    """How often each unit was started."""
    units = json.loads((folder / "plan.json").read_text())["units"]
    files = [folder / "units" / unit["id"] / "starts.txt" for unit in units]
    return [len(file.read_text().splitlines()) if file.is_file() else 0 for file in files]


def test_a_fleet_is_planned_and_gathered(tmp_path):
    lab = laboratory(tmp_path, [{}, {"exit": 3}, {"exit": 1}])
    folder = fleet.plan(lab, tmp_path / "fleet", command="rehearse", verbose=False)
    quadverse.qv("fleet", "run", folder, verbose=False)
    found = fleet.gather(folder)
    assert found.counts == {"done": 1, "failed": 1, "finding": 1, "missing": 0}
    assert found.failures[0]["kind"] == "failed" and len(found.to_pandas()) == 3
    assert "1 failed" in repr(found) and "<iframe" in found._repr_html_()
    with pytest.raises(quadverse.QvError, match="unexpected argument"):
        fleet.plan(lab, tmp_path / "other", options=["--no-such-option"], verbose=False)


@pytest.mark.slow
def test_a_cluster_loses_workers_and_a_machine_and_no_unit(tmp_path):
    ray = pytest.importorskip("ray", reason="no Ray: `cargo xtask python --ray` installs it")
    from ray.cluster_utils import Cluster

    # Units of a second, one whose recording is damaged, one over its memory, one that says a finding.
    parts = [{"seconds": 1.0} for _ in range(16)] + [{"mib": 600, "seconds": 30.0}, {"exit": 3}, {"exit": 1}]
    lab = laboratory(tmp_path, parts)
    folder = fleet.plan(lab, tmp_path / "fleet", command="rehearse", verbose=False)
    alone = fleet.plan(lab, tmp_path / "alone", command="rehearse", verbose=False)
    for one in (folder, alone):
        assert len(starts(one)) == len(parts)
    # Damaged after it was planned: it is not what was planned any more.
    (lab / "run03" / "run.csv").write_bytes(b"\x00\x01")

    cluster = Cluster(initialize_head=True, head_node_args={"num_cpus": 1})
    nodes = [cluster.add_node(num_cpus=2) for _ in range(2)]
    ray.init(address=cluster.address, log_to_driver=False)
    try:
        import threading

        killed = []

        def break_things():
            while sum(starts(folder)) < 3:
                time.sleep(0.05)
            # The worker of a unit that is being worked on, with -9.
            while not (found := workers()):
                time.sleep(0.02)
            os.kill(found[0], signal.SIGKILL)
            killed.append(found[0])
            while sum(starts(folder)) < 6:
                time.sleep(0.05)
            cluster.remove_node(nodes[1], allow_graceful=False)
            killed.append("node")

        def workers():
            """Processes of Ray whose child is ``qv``."""
            listed = subprocess.run(["ps", "-ww", "-eo", "pid,ppid,args"], capture_output=True, text=True).stdout
            rows = [line.split(None, 2) for line in listed.splitlines()[1:]]
            return [int(row[1]) for row in rows if str(folder) in row[2] and "--unit" in row[2] and "--quiet" in row[2]]

        breaker = threading.Thread(target=break_things, daemon=True)
        breaker.start()
        found = fleet.run(folder, cluster.address, memory=300, timeout=60, program=program(), verbose=False)
        breaker.join(60)
        assert len(killed) == 2 and killed[1] == "node"
    finally:
        ray.shutdown()
        cluster.shutdown()
    assert found.counts == {"done": 15, "failed": 3, "finding": 1, "missing": 0}
    assert sorted(failure["kind"] for failure in found.failures) == ["failed", "input_changed", "memory"]
    # Nothing is done twice: only what was killed on the way was started again.
    done = [path for path in (folder / "units").glob("*/done.json")]
    assert len(done) == 16
    again = starts(folder)
    quadverse.qv("fleet", "run", folder, "--memory", 300, "--timeout", 60, verbose=False)
    undone = [json.loads(path.read_text())["unit"] for path in (folder / "units").glob("*/failed.json")]
    units = [unit["id"] for unit in json.loads((folder / "plan.json").read_text())["units"]]
    for unit, before, after in zip(units, again, starts(folder)):
        assert after == before or unit in undone
    # The same bytes as without Ray.
    quadverse.qv("fleet", "run", alone, "--jobs", 4, "--memory", 300, "--timeout", 60, verbose=False)
    fleet.gather(alone)
    for name in ("fleet.json", "fleet.html"):
        assert (folder / name).read_bytes() == (alone / name).read_bytes(), name
    assert Path(folder / "cost.json").is_file()
