from typing import Any

import torch
from rsl_rl.env import VecEnv
from tensordict import TensorDict

from ._quadverse import VelocityTask

class VelocityVecEnv(VecEnv):
    task: VelocityTask
    max_episode_length: int
    def __init__(self, num_envs: int, seed: int = 0, device: str = "cpu") -> None: ...
    def get_observations(self) -> TensorDict: ...
    def step(self, actions: torch.Tensor) -> tuple[TensorDict, torch.Tensor, torch.Tensor, dict[str, Any]]: ...

def settings(**changes: Any) -> dict[str, Any]: ...
