"""The command line ``qv``, which comes with the package, called from Python."""

import html
import json
import os
import shutil
import signal
import subprocess
import sys
import sysconfig
import tempfile
import threading
from pathlib import Path

from ._extras import need
from .recording import Recording
from .report import _Files


class QvError(RuntimeError):
    """A command that failed; its text is what the command said."""


def program():
    """The path of ``qv``: that of this environment, else one on the search path."""
    name = "qv.exe" if os.name == "nt" else "qv"
    own = Path(sysconfig.get_path("scripts")) / name
    found = str(own) if own.is_file() else shutil.which(name)
    if found is None:
        raise FileNotFoundError(f"expected the program qv at {own} or on the search path, found none")
    return found


def qv(*words, verbose=True):
    """Runs ``qv`` with these words and gives what it printed; with ``verbose``, what it tells goes to ``sys.stderr``.

    A failure raises ``QvError``. Ctrl-C goes on to the command, which keeps what it has where its help says so.
    """
    process = subprocess.Popen(
        [program(), *map(str, words)], stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE
    )
    messages = []

    def listen():
        for line in process.stderr:
            messages.append(line.decode(errors="replace").rstrip())
            if verbose:
                print(messages[-1], file=sys.stderr)

    listener = threading.Thread(target=listen, daemon=True)
    listener.start()
    try:
        printed = process.stdout.read().decode(errors="replace")
    except BaseException:
        process.send_signal(signal.SIGTERM if os.name == "nt" else signal.SIGINT)
        raise
    finally:
        process.wait()
        listener.join()
        process.stdout.close()
        process.stderr.close()
    # 3: part of the input could not be used, which was reported.
    if process.returncode not in (0, 3):
        raise QvError("\n".join(messages) or f"qv {words[0]} ended with {process.returncode}")
    return printed


def main():
    """``python -m quadverse``: the command line, as it is."""
    words = [program(), *sys.argv[1:]]
    if os.name == "nt":
        sys.exit(subprocess.call(words))
    os.execv(words[0], words)


def _options(**given):
    """``max_seconds=3`` is ``--max-seconds 3``; what is true is a flag, what is false or none is left out, lists are joined by commas."""
    words = []
    for name, value in given.items():
        if value is None or value is False:
            continue
        words.append("--" + name.replace("_", "-"))
        if isinstance(value, (list, tuple)):
            # One word, as a list may begin with a minus.
            words[-1] += "=" + ",".join(map(str, value))
        elif value is not True:
            words.append(os.fspath(value) if isinstance(value, os.PathLike) else str(value))
    return words


def _several(what):
    return list(what) if isinstance(what, (list, tuple)) else [what]


def _places(recordings):
    """Paths of recordings, and how the first of them was opened."""
    several = _several(recordings)
    opened = next((one for one in several if isinstance(one, Recording)), None)
    paths = [one.path if isinstance(one, Recording) else os.fspath(one) for one in several]
    return paths, dict(opened.reading) if opened else {}


def _write_parameters(folder, parameters):
    """A file for ``--params`` of a dict; a path is one already."""
    if parameters is None or isinstance(parameters, (str, os.PathLike)):
        return parameters
    lines = [f"{json.dumps(name)} = {float(value)!r}\n" for name, value in parameters.items()]
    path = Path(folder) / "parameters.toml"
    path.write_text("".join(lines))
    return path


class Contact(_Files):
    """Friction by material; ``fields`` are those of ``contact.json``."""

    def __init__(self, files):
        super().__init__(files, "contact.json", "contact.html")

    @property
    def frictions(self):
        """Friction by label."""
        return {region["label"]: region["friction"] for region in self.fields["regions"]}

    def to_pandas(self):
        """A row per material: friction, prior, evidence, time on it (needs pandas)."""
        pandas = need("pandas")

        return pandas.DataFrame([{k: v for k, v in r.items() if k != "curves"} for r in self.fields["regions"]])

    def __repr__(self):
        return "Contact: " + ", ".join(f"{label} {friction:.3f}" for label, friction in self.frictions.items())


def contact(
    recordings,
    terrain,
    *,
    robot=None,
    parameters=None,
    materials=None,
    slip_threshold=None,
    uniform=None,
    segment=None,
    verbose=False,
):
    """Finds the friction of each material of a labelled ground (a GLB file) from recordings of a robot that walked on it."""
    paths, reading = _places(recordings)
    if robot is not None:
        reading["robot"] = robot
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "out"
        words = _options(
            **reading,
            terrain=terrain,
            params=_write_parameters(folder, parameters),
            materials=materials,
            slip_threshold=slip_threshold,
            uniform=uniform,
            segment=segment,
            out=out,
        )
        qv("contact", *paths, *words, verbose=verbose)
        return Contact({file.name: file.read_bytes() for file in out.iterdir()})


def _framed(page):
    """A page within the page of a notebook."""
    return f'<iframe srcdoc="{html.escape(page.read_text())}" width="100%" height="600"></iframe>'


class Policy:
    """A walking policy in a folder: ``policy.onnx``, ``policy.toml``, ``walk.html`` and what the training wrote."""

    def __init__(self, folder):
        self.folder = Path(folder)
        self.onnx = self.folder / "policy.onnx"
        if not self.onnx.is_file():
            raise FileNotFoundError(f"{self.onnx}: expected a policy, found none")

    @property
    def metrics(self):
        """A dict per iteration of the training."""
        return json.loads((self.folder / "metrics.json").read_text())

    @property
    def score(self):
        """The last score of the training: errors of the velocity [m/s] and of turning [rad/s], how many fell; ``None`` where it was too short for one."""
        scores = [line["score"] for line in self.metrics if line.get("score")]
        return scores[-1] if scores else None

    def to_pandas(self):
        """The training, a row per iteration (needs pandas)."""
        pandas = need("pandas")

        return pandas.DataFrame(self.metrics)

    def _repr_html_(self):
        return _framed(self.folder / "walk.html")

    def __repr__(self):
        return f"Policy in {self.folder}"


def train_walk(
    out,
    *,
    robot="go2",
    ground="plane",
    iterations=None,
    max_seconds=None,
    until=None,
    robots=None,
    seed=None,
    robust=False,
    around=None,
    vx=None,
    vy=None,
    wz=None,
    settings=None,
    resume=False,
    start_from=None,
    threads=None,
    verbose=True,
):
    """Train a locomotion policy into the folder ``out``; arguments are those of ``qv walk train``.

    ``around`` is a calibrated.toml, or a dict of parameters such as ``Report.calibrated``.
    """
    with tempfile.TemporaryDirectory() as folder:
        words = _options(
            robot=robot,
            terrain=ground,
            iterations=iterations,
            max_seconds=max_seconds,
            until=until,
            robots=robots,
            seed=seed,
            robust=robust,
            params=_write_parameters(folder, around),
            vx=vx,
            vy=vy,
            wz=wz,
            settings=settings,
            resume=resume,
            start_from=start_from,
            threads=threads,
            out=out,
        )
        qv("walk", "train", *words, verbose=verbose)
    return Policy(out)


class Tuned(Policy):
    """A policy fine-tuned on recordings; ``fields`` are those of ``tune.json``."""

    def __init__(self, folder):
        super().__init__(folder)
        self.fields = json.loads((self.folder / "tune.json").read_text())

    def _repr_html_(self):
        return _framed(self.folder / "tune.html")

    def __repr__(self):
        return f"Tuned: {self.fields['why']}"


def tune(
    recordings,
    policy,
    out,
    *,
    robot="go2",
    terrain="plane",
    train_on=None,
    calibrated=None,
    settings=None,
    iterations=None,
    seed=None,
    threads=None,
    verbose=True,
):
    """Trains ``policy`` (a ``Policy``, or its policy.onnx) on under what recordings of the robot under it show of its motors."""
    paths, reading = _places(recordings)
    with tempfile.TemporaryDirectory() as folder:
        words = _options(
            policy=policy.onnx if isinstance(policy, Policy) else policy,
            robot=robot,
            terrain=terrain,
            train_on=train_on,
            pose_topic=reading.get("pose_topic"),
            calibrated=_write_parameters(folder, calibrated),
            settings=settings,
            iterations=iterations,
            seed=seed,
            threads=threads,
            out=out,
        )
        qv("tune", *paths, *words, verbose=verbose)
    return Tuned(out)
