from collections.abc import Sequence
from os import PathLike

from numpy import float32, float64, uint8
from numpy.typing import ArrayLike, NDArray

COLOURS: tuple[str, ...]

class Recall:
    def __init__(self, half: Sequence[float]) -> None: ...
    def go(self, x: float, y: float, yaw: float) -> None: ...
    def see(self, sight: ArrayLike) -> None: ...
    def features(self) -> NDArray[float32]: ...

def reflex(
    recall: Recall,
    command: Sequence[float] | NDArray[float32],
    odds: float = 1.1,
    margin: float = 0.16,
    push: float = 0.5,
    stand_off: float = 0.25,
    approach: float = 1.0,
    creep: float = 0.06,
) -> list[float]: ...

class Navigator:
    recall: Recall
    def __init__(self, policy: str | PathLike[str], colour: str) -> None: ...
    def decide(
        self, frame: NDArray[uint8], gravity: Sequence[float], odometry: tuple[float, float, float]
    ) -> NDArray[float64]: ...
