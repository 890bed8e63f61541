from collections.abc import Callable, Mapping, Sequence
from os import PathLike
from typing import Any

from numpy import float64
from numpy.typing import NDArray

from .recording import Recording

Source = Recording | str | PathLike[str]

class Replay:
    fields: dict[str, Any]
    sentence: str
    html: str
    joint_names: list[str]
    recorded: dict[str, NDArray[float64]]
    simulated: dict[str, NDArray[float64]]
    def __getattr__(self, name: str) -> Any: ...

class _Files:
    files: dict[str, bytes]
    fields: dict[str, Any]
    @property
    def html(self) -> str: ...
    def save(self, folder: str | PathLike[str]) -> None: ...
    def __getattr__(self, name: str) -> Any: ...

class Report(_Files):
    fields: dict[str, Any]
    files: dict[str, bytes]
    verdict: str
    sentence: str
    causes: list[dict[str, Any]]
    ranking: list[dict[str, Any]]
    corrections: list[dict[str, Any]]
    @property
    def html(self) -> str: ...
    @property
    def calibrated(self) -> dict[str, float]: ...
    def save(self, folder: str | PathLike[str]) -> None: ...
    def to_pandas(self) -> Any: ...
    def __getattr__(self, name: str) -> Any: ...

def replay(
    recording: Source,
    *,
    robot: str | None = None,
    terrain: str | PathLike[str] = "plane",
    parameters: Mapping[str, float] | None = None,
    window: float = 0.3,
) -> Replay: ...
def diagnose(
    recordings: Source | Sequence[Source],
    *,
    robot: str | None = None,
    reference: Sequence[Source] = (),
    terrain: str | PathLike[str] = "plane",
    parameters: Mapping[str, float] | None = None,
    without: Sequence[str] = (),
    library: str | PathLike[str] | None = None,
    seed: int = 1,
    ground_error: float | None = None,
    progress: Callable[[int, int, str, float], object] | None = None,
) -> Report: ...
