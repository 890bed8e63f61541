from os import PathLike
from typing import Any, Literal

from numpy import float64
from numpy.typing import ArrayLike, NDArray

from . import _quadverse

class Batch(_quadverse.Batch):
    def __new__(
        cls,
        robot: str | PathLike[str],
        n: int,
        terrain: str | PathLike[str] = "plane",
        *,
        base: Literal["free", "fixed"] = "free",
        timestep: float = 0.001,
        max_command_latency: float = 0.0,
        keep_contacts: bool = False,
        self_collision: bool = False,
    ) -> Batch: ...
    def expand(self, pattern: str) -> Parameters: ...

class Parameters:
    names: list[str]
    shape: tuple[int, int]
    def __getitem__(self, key: Any) -> NDArray[float64]: ...
    def __setitem__(self, key: Any, values: ArrayLike) -> None: ...
    def __array__(self, dtype: Any = None, copy: bool | None = None) -> NDArray[Any]: ...
    def __len__(self) -> int: ...
