from collections.abc import Mapping, Sequence
from os import PathLike
from pathlib import Path
from typing import Any

from .recording import Recording
from .report import _Files

_Path = str | PathLike[str]
_Source = Recording | _Path
_Parameters = Mapping[str, float] | _Path

class QvError(RuntimeError): ...

def program() -> str: ...
def qv(*words: object, verbose: bool = True) -> str: ...
def main() -> None: ...

class Contact(_Files):
    regions: list[dict[str, Any]]
    @property
    def frictions(self) -> dict[str, float]: ...
    def to_pandas(self) -> Any: ...

def contact(
    recordings: _Source | Sequence[_Source],
    terrain: _Path,
    *,
    robot: _Path | None = None,
    parameters: _Parameters | None = None,
    materials: _Path | None = None,
    slip_threshold: float | None = None,
    uniform: float | None = None,
    segment: float | None = None,
    verbose: bool = False,
) -> Contact: ...

class Policy:
    folder: Path
    onnx: Path
    def __init__(self, folder: _Path) -> None: ...
    @property
    def metrics(self) -> list[dict[str, Any]]: ...
    @property
    def score(self) -> dict[str, Any] | None: ...
    def to_pandas(self) -> Any: ...

def train_walk(
    out: _Path,
    *,
    robot: _Path = "go2",
    ground: _Path = "plane",
    iterations: int | None = None,
    max_seconds: float | None = None,
    until: tuple[float, float] | None = None,
    robots: int | None = None,
    seed: int | None = None,
    robust: bool = False,
    around: _Parameters | None = None,
    vx: tuple[float, float] | None = None,
    vy: tuple[float, float] | None = None,
    wz: tuple[float, float] | None = None,
    settings: _Path | None = None,
    resume: bool = False,
    start_from: _Path | None = None,
    threads: int | None = None,
    verbose: bool = True,
) -> Policy: ...

class Tuned(Policy):
    fields: dict[str, Any]

def tune(
    recordings: _Source | Sequence[_Source],
    policy: Policy | _Path,
    out: _Path,
    *,
    robot: _Path = "go2",
    terrain: _Path = "plane",
    train_on: _Path | None = None,
    calibrated: _Parameters | None = None,
    settings: _Path | None = None,
    iterations: int | None = None,
    seed: int | None = None,
    threads: int | None = None,
    verbose: bool = True,
) -> Tuned: ...
