"""Replay and diagnosis of recordings."""

import html
import json
import os
from pathlib import Path

from . import _quadverse
from ._extras import need
from .recording import Recording, open


class _Fields:
    """The fields of a JSON report as attributes."""

    def __getattr__(self, name):
        if name.startswith("_"):
            raise AttributeError(name)
        fields = self.__dict__.get("fields", {})
        if name not in fields:
            raise AttributeError(f"the report has no {name!r}; it has {', '.join(sorted(fields))}")
        return fields[name]

    def __dir__(self):
        return sorted(set(super().__dir__()) | set(self.fields))


class Replay(_Fields):
    """A recording's commands in the simulator; ``fields`` are those of ``replay.json``.

    ``recorded`` and ``simulated`` are dicts of arrays: time, position, velocity, torque, and for a free base base, foot_force.
    """

    def __init__(self, found):
        self.fields = json.loads(found["report"])
        self.sentence, self.html = found["verdict"], found["html"]
        self.joint_names = found["joint_names"]
        self.recorded, self.simulated = found["recorded"], found["simulated"]

    def __repr__(self):
        return f"Replay: {self.sentence}"


class _Files(_Fields):
    """The files of a command; the fields are those of one of them."""

    def __init__(self, files, fields, page):
        self.files, self._page = files, page
        self.fields = json.loads(files[fields])

    @property
    def html(self):
        """The whole page."""
        return self.files[self._page].decode()

    def save(self, folder):
        """Writes all files into ``folder``, each under another name first."""
        folder = Path(folder)
        folder.mkdir(parents=True, exist_ok=True)
        for name, content in self.files.items():
            unfinished = folder / f".{name}.{os.getpid()}"
            unfinished.write_bytes(content)
            os.replace(unfinished, folder / name)


class Report(_Files):
    """A diagnosis; ``fields`` are those of ``report.json`` (``place`` is its ``where``)."""

    def __init__(self, files):
        super().__init__(files, "report.json", "report.html")
        self.fields["place"] = self.fields["where"]

    @property
    def calibrated(self):
        """The corrections as a dict of parameters; ``replay`` takes it."""
        if not self.fields["corrections_apply"]:
            return {}
        return {c["parameter"]: c["value"] for c in self.fields["corrections"]}

    def to_pandas(self):
        """The ranking of the effects as a DataFrame (needs pandas)."""
        pandas = need("pandas")

        return pandas.DataFrame(self.fields["ranking"])

    def __repr__(self):
        return f"Report: {self.fields['sentence']}"

    def _repr_html_(self):
        rows = "".join(
            f"<tr><td>{html.escape(r['effect'])}</td><td>{r['score']:.2f}</td></tr>"
            for r in self.fields["ranking"][:6]
        )
        sentence = html.escape(self.fields["sentence"])
        return f"<p><b>{sentence}</b></p><table><tr><th>effect</th><th>score</th></tr>{rows}</table>"


def _recording(what, robot):
    return what if isinstance(what, Recording) else open(what, robot=robot)


def _all(what, robot):
    several = what if isinstance(what, (list, tuple)) else [what]
    return [_recording(one, robot)._native for one in several]


def _parameters(given):
    return [(str(name), float(value)) for name, value in (given or {}).items()]


def replay(recording, *, robot=None, terrain="plane", parameters=None, window=0.3):
    """Replays a recording (or the path of one) in the simulator, whole and in windows of ``window`` seconds."""
    native = _recording(recording, robot)._native
    return Replay(_quadverse.replay(native, os.fspath(terrain), _parameters(parameters), window))


def diagnose(
    recordings,
    *,
    robot=None,
    reference=(),
    terrain="plane",
    parameters=None,
    without=(),
    library=None,
    seed=1,
    ground_error=None,
    progress=None,
):
    """Says where the gap between robot and simulator lies, what causes it, and how far it shrinks.

    ``progress`` is called with each stage that begins: its number, how many there are, its name, the share that is done.
    Ctrl-C, or what ``progress`` raises, ends it.
    """
    terrain = os.fspath(terrain)
    if ground_error is None:
        ground_error = 0.0 if terrain == "plane" else 0.003
    return Report(
        _quadverse.diagnose(
            _all(recordings, robot),
            _all(list(reference), robot),
            terrain,
            _parameters(parameters),
            list(without),
            library,
            seed,
            ground_error,
            progress,
        )
    )
