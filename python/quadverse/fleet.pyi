from collections.abc import Sequence
from os import PathLike
from pathlib import Path
from typing import Any, Literal

_Path = str | PathLike[str]

class Result:
    folder: Path
    fields: dict[str, Any]
    def __init__(self, folder: _Path) -> None: ...
    @property
    def counts(self) -> dict[str, int]: ...
    @property
    def failures(self) -> list[dict[str, Any]]: ...
    def to_pandas(self) -> Any: ...

def plan(
    folders: _Path | Sequence[_Path],
    out: _Path,
    *,
    command: Literal["diagnose", "contact", "tune"] = "diagnose",
    group: bool = False,
    robots_by: Literal["model", "folder"] | None = None,
    options: Sequence[object] = (),
    verbose: bool = True,
) -> Path: ...
def gather(folder: _Path, *, verbose: bool = False) -> Result: ...
def run(
    plan: _Path,
    address: str = "auto",
    *,
    cpus: float = 1,
    memory: int | None = None,
    timeout: float | None = None,
    retries: int = 0,
    task_retries: int = 5,
    program: _Path | None = None,
    verbose: bool = True,
) -> Result: ...
