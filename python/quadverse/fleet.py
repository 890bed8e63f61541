"""Many recordings on a Ray cluster: each unit of a plan of ``qv fleet plan`` is a task.

The machines of the cluster see the folder of the fleet and the recordings under the same paths, and have this package. A task runs
``qv fleet run F --unit I``: what is done, and what is done by whom, stands in the folder. A task that Ray starts again finds its unit
done, or waits for who works on it; so nothing is done twice, and nothing is lost with a worker or a machine.
"""

import json
import os
import subprocess
import time
from pathlib import Path

from ._extras import need
from .command import QvError, _options, program, qv

#: Seconds from a SIGTERM to the end of ``qv``, which stops its child first.
_PATIENCE = 10.0


class Result:
    """What became of the units; ``fields`` are those of fleet.json."""

    def __init__(self, folder):
        self.folder = Path(folder)
        self.fields = json.loads((self.folder / "fleet.json").read_text())

    @property
    def counts(self):
        """How many units are done, done with a finding, failed, missing."""
        return self.fields["counts"]

    @property
    def failures(self):
        """Failures by reason."""
        return self.fields["failures"]

    def to_pandas(self):
        """A row for each unit (needs pandas)."""
        pandas = need("pandas")

        return pandas.DataFrame(self.fields["units"])

    def _repr_html_(self):
        import html

        page = (self.folder / "fleet.html").read_text()
        return f'<iframe srcdoc="{html.escape(page)}" width="100%" height="600"></iframe>'

    def __repr__(self):
        counts = ", ".join(f"{count} {state}" for state, count in self.counts.items() if count)
        return f"Fleet of {len(self.fields['units'])} units: {counts}"


def plan(folders, out, *, command="diagnose", group=False, robots_by=None, options=(), verbose=True):
    """Finds recordings below ``folders`` and writes ``out/plan.json``, as ``qv fleet plan``; ``options`` go on to the command."""
    folders = list(folders) if isinstance(folders, (list, tuple)) else [folders]
    words = _options(out=out, command=command, group=group, robots_by=robots_by)
    qv("fleet", "plan", *folders, *words, "--", *map(str, options), verbose=verbose)
    return Path(out)


def gather(folder, *, verbose=False):
    """Puts what is done on one page, as ``qv fleet gather``."""
    qv("fleet", "gather", folder, verbose=verbose)
    return Result(folder)


def _unit(folder, unit, words, path=None):
    """Runs one unit and gives its exit code: 0 done, 3 done with a finding, 1 failed, which the folder says, too."""
    process = subprocess.Popen(
        [path or program(), "--quiet", "fleet", "run", str(folder), "--unit", unit, *words],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
    )
    try:
        message = process.communicate()[1].decode(errors="replace")
    except BaseException:
        process.terminate()
        try:
            process.wait(_PATIENCE)
        except subprocess.TimeoutExpired:
            process.kill()
        raise
    code = process.returncode
    # A unit that failed is a result. What ends otherwise is the affair of the machine: Ray starts it again.
    if code not in (0, 1, 3):
        raise QvError(message or f"qv fleet run ended with {code}")
    if code == 1 and not any((Path(folder) / "units" / unit / name).is_file() for name in ("failed.json", "done.json")):
        raise QvError(message)
    return code


def run(plan, address="auto", *, cpus=1, memory=None, timeout=None, retries=0, task_retries=5, program=None, verbose=True):
    """Does what a plan says and is not done yet on a Ray cluster, and gathers it.

    ``plan`` is the folder of a fleet. ``address`` is that of ``ray.init``; where Ray runs already, that is taken. A task takes ``cpus``
    processors, and ``memory`` [MiB] where that is given: a unit above it is killed. ``timeout`` [s] and ``retries`` are those of ``qv fleet
    run``; ``task_retries`` is how often a task is started again whose worker or machine is lost. ``program`` is ``qv`` on the workers;
    by default that of their package.
    """
    ray = need("ray", "'ray>=2.50'")

    folder = Path(os.path.abspath(plan))
    units = [unit["id"] for unit in json.loads((folder / "plan.json").read_text())["units"]]
    if not ray.is_initialized():
        ray.init(address=address)
    words = _options(memory=memory, timeout=timeout, retries=retries or None)
    # Ray's own limit lies above ours, so that the unit says why it ended.
    resources = {"num_cpus": cpus, **({"memory": (memory + 256) << 20} if memory else {})}
    environment = {"env_vars": {"RAYON_NUM_THREADS": str(max(1, int(cpus)))}}
    task = ray.remote(max_retries=task_retries, retry_exceptions=[QvError], runtime_env=environment, **resources)(_unit)
    waiting = {task.remote(str(folder), unit, words, program): unit for unit in units}
    begun, lost = time.monotonic(), {}
    try:
        while waiting:
            ready, _ = ray.wait(list(waiting), num_returns=1)
            for reference in ready:
                unit = waiting.pop(reference)
                try:
                    ray.get(reference)
                except (ray.exceptions.RayError, QvError) as error:
                    lost[unit] = str(error).strip().splitlines()[-1]
            if verbose:
                done = len(units) - len(waiting)
                left = (time.monotonic() - begun) / done * len(waiting)
                print(f"{done} of {len(units)} units, {len(lost)} lost, about {left:.0f} s left", end="\r", flush=True)
    except BaseException:
        for reference in waiting:
            ray.cancel(reference)
        raise
    if verbose:
        print()
    result = gather(folder)
    if lost:
        unit, why = next(iter(lost.items()))
        raise QvError(f"{len(lost)} of {len(units)} units were lost, such as {unit}: {why}")
    return result
