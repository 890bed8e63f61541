from collections.abc import Sequence
from os import PathLike
from typing import Any

from gymnasium.vector import VectorEnv
from numpy import bool_, float32
from numpy.typing import NDArray

from ._quadverse import Cloud, NavigationTask, VelocityTask

class VelocityEnv(VectorEnv):
    task: VelocityTask
    def __init__(self, num_envs: int, seed: int = 0) -> None: ...
    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[float32], dict[str, Any]]: ...
    def step(
        self, actions: Any
    ) -> tuple[NDArray[float32], NDArray[float32], NDArray[bool_], NDArray[bool_], dict[str, Any]]: ...

FINAL: tuple[str, ...]

class NavigationEnv(VectorEnv):
    task: NavigationTask
    def __init__(
        self,
        num_envs: int,
        scene: Cloud | str | PathLike[str],
        mesh: str | PathLike[str],
        seed: int = 0,
        *,
        camera: str = "wide",
        hidden_effects: bool = False,
        goals: Sequence[str] = ("in_view", "turned", "hidden"),
    ) -> None: ...
    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]: ...
    def step(
        self, actions: Any
    ) -> tuple[dict[str, NDArray[Any]], NDArray[float32], NDArray[bool_], NDArray[bool_], dict[str, Any]]: ...
