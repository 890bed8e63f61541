"""The velocity and the navigation task as vector environments of gymnasium (``pip install quadverse[gym]``)."""

import os

import numpy as np

from ._extras import need

need("gymnasium")
from gymnasium import spaces
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from . import _quadverse
from .view import open_cloud


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


#: Ends of an episode that are the robot's doing; the others are that its time was over.
FINAL = ("reached", "collision", "cone pushed", "fell")


class NavigationEnv(VectorEnv):
    """``num_envs`` robots, each to find a coloured cone in a reconstructed place, from pictures.

    ``scene`` is a file of Gaussians or a ``Cloud``, ``mesh`` the labelled mesh of the same place (GLB). A scene is drawn over what it was
    made over; one that was made over black, or does not say over what, before a sky. ``camera`` says how much cameras differ from episode to episode: "wide" or "none". ``hidden_effects`` makes the legs late, weak and slippery.
    ``goals`` come in turn: in the picture at the start, beside it, behind an obstacle.

    An observation has ``picture`` (60, 80, 3) and ``state`` (8): the wanted colour as one of red, blue, yellow; the direction of
    gravity in the base; sine and cosine of the heading since the start. An action is a share, -1 to 1, of the limits of the
    speed forwards (-0.2 to 0.6 m/s), to the left (0.3 m/s), and of the turning rate (1 rad/s), held for 0.2 s. The reward is the
    length by which the shortest way to the goal became shorter [m], and 5 for the goal, -2 for a collision, a pushed
    cone or a fall. Who ends is reset in the same step; ``info["final_obs"]`` has what it saw last, ``info["end"]`` how it ended.
    """

    metadata = {"autoreset_mode": AutoresetMode.SAME_STEP}

    def __init__(
        self, num_envs, scene, mesh, seed=0, *, camera="wide", hidden_effects=False, goals=("in_view", "turned", "hidden")
    ):
        if not isinstance(scene, _quadverse.Cloud):
            scene = open_cloud(scene)
        self.task = _quadverse.NavigationTask(
            scene, os.fspath(mesh), num_envs, seed, camera=camera, hidden_effects=hidden_effects, goals=list(goals)
        )
        self.num_envs = num_envs
        self.single_observation_space = spaces.Dict(
            {
                "picture": spaces.Box(0, 255, tuple(self.task.picture_shape), np.uint8),
                "state": spaces.Box(-1, 1, (self.task.state_size,), np.float32),
            }
        )
        self.single_action_space = spaces.Box(-1, 1, (self.task.action_size,), np.float32)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)

    def _observe(self, which):
        pictures, state = self.task.observe(which)
        # Rounding may bring a unit vector a bit above one.
        return {"picture": pictures, "state": np.clip(state, -1, 1)}

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        # Without a seed the episodes are others each time, but those of the generator's seed.
        self.task.restart(int(self.np_random.integers(2**63)) if seed is None else seed)
        return self._observe(np.ones(self.num_envs, bool)), {}

    def step(self, actions):
        rewards, ends = self.task.step(np.ascontiguousarray(actions, np.float32))
        failed = np.array([end in FINAL for end in ends])
        over = np.array([end is not None and end not in FINAL for end in ends])
        observations, info, ended = self._observe(np.ones(self.num_envs, bool)), {}, failed | over
        if ended.any():
            info = {"final_obs": observations, "_final_obs": ended, "end": np.array(ends, object), "_end": ended}
            self.task.reset(ended)
            observations = self._observe(ended)
        return observations, rewards, failed, over, info
