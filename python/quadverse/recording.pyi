from collections.abc import Iterator
from os import PathLike
from typing import Any

from numpy import float64
from numpy.typing import NDArray

class Recording:
    path: str
    robot: str | None
    base: str
    joint_names: list[str]
    foot_names: list[str]
    span: tuple[float, float]
    channels: list[str]
    lost: list[str]
    remarks: list[str]
    reading: dict[str, str | None]
    @property
    def faults(self) -> list[dict[str, Any]]: ...
    def __getitem__(self, channel: str) -> tuple[NDArray[float64], NDArray[float64]]: ...
    def __iter__(self) -> Iterator[str]: ...
    def __contains__(self, channel: str) -> bool: ...
    def to_pandas(self, channel: str) -> Any: ...

def open(
    path: str | PathLike[str],
    *,
    robot: str | PathLike[str] | None = None,
    pose_topic: str | None = None,
    namespace: str | None = None,
) -> Recording: ...
