"""The velocity task as a vector environment of gymnasium (``pip install quadverse[gym]``)."""

import numpy as np
from gymnasium import spaces
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from . import _quadverse


class VelocityEnv(VectorEnv):
    """``num_envs`` Go2 on a plane, each to follow a commanded velocity.

    An action moves the joints' targets around the stand. Who ends is reset in the same step; what it saw last is in
    ``info["final_obs"]``.
    """

    metadata = {"autoreset_mode": AutoresetMode.SAME_STEP}

    def __init__(self, num_envs, seed=0):
        self.task = _quadverse.VelocityTask(num_envs, seed)
        self.num_envs = num_envs
        self.offset, self.scale = self.task.scaling()
        size, actions = self.task.observation_size, self.task.action_size
        self.single_observation_space = spaces.Box(-np.inf, np.inf, (size,), np.float32)
        self.single_action_space = spaces.Box(-np.inf, np.inf, (actions,), np.float32)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)

    def _observe(self):
        return (self.task.observe() - self.offset) * self.scale

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        # Without a seed the episodes are others each time, but those of the generator's seed.
        self.task.restart(int(self.np_random.integers(2**63)) if seed is None else seed)
        return self._observe(), {}

    def step(self, actions):
        actions = np.ascontiguousarray(actions, np.float32)
        rewards, failed, over = self.task.step(actions)
        observations, info, ended = self._observe(), {}, failed | over
        if ended.any():
            info = {"final_obs": observations, "_final_obs": ended}
            self.task.reset(ended)
            observations = self._observe()
        return observations, rewards, failed, over, info
