from collections.abc import Mapping, Sequence
from os import PathLike
from typing import Any

from numpy.typing import ArrayLike

from ._quadverse import Cloud as Cloud

_Path = str | PathLike[str]

def open_cloud(path: _Path) -> Cloud: ...
def cloud(
    means: ArrayLike, log_scales: ArrayLike, rotations: ArrayLike, opacity_logits: ArrayLike, sh: ArrayLike
) -> Cloud: ...
def render(
    scene: Cloud | _Path,
    cameras: _Path | Mapping[str, Any] | Sequence[Mapping[str, Any]],
    *,
    background: Sequence[float] | None = None,
) -> list[dict[str, Any]]: ...
