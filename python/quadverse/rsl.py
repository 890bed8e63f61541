"""The velocity task as an environment of rsl_rl (``pip install quadverse[rsl]``)."""

import numpy as np

from ._extras import need

need("torch")
need("rsl_rl", "rsl-rl-lib")
import torch
from rsl_rl.env import VecEnv
from tensordict import TensorDict

from . import _quadverse


class VelocityVecEnv(VecEnv):
    """``num_envs`` Go2 on a plane, each to follow a commanded velocity.

    Observations have the groups ``policy`` (what the robot's sensors tell) and ``privileged`` (what only a critic should see), each of the size of
    one. Who ends is reset in the same step.
    """

    def __init__(self, num_envs, seed=0, device="cpu"):
        self.task = _quadverse.VelocityTask(num_envs, seed)
        self.num_envs, self.num_actions, self.device = num_envs, self.task.action_size, device
        self.max_episode_length = round(self.task.episode / self.task.dt)
        self.episode_length_buf = torch.zeros(num_envs, dtype=torch.long, device=device)
        self.cfg = {"task": "velocity", "robot": "go2", "num_envs": num_envs, "seed": seed}
        self._scaling = self.task.scaling(), self.task.privileged_scaling()

    def get_observations(self):
        groups = {}
        for name, values, (offset, scale) in zip(
            ("policy", "privileged"), (self.task.observe(), self.task.privileged()), self._scaling
        ):
            groups[name] = torch.from_numpy((values - offset) * scale).to(self.device)
        return TensorDict(groups, batch_size=[self.num_envs], device=self.device)

    def step(self, actions):
        rewards, failed, over = self.task.step(np.ascontiguousarray(actions.detach().cpu().numpy(), np.float32))
        ended = failed | over
        self.episode_length_buf += 1
        if ended.any():
            self.task.reset(ended)
            self.episode_length_buf[torch.from_numpy(ended)] = 0
        extras = {"time_outs": torch.from_numpy(over).to(self.device)}
        if figures := self.task.figures():
            extras["log"] = {f"/{name}": value for name, value in figures}
        done = torch.from_numpy(ended).to(self.device)
        return self.get_observations(), torch.from_numpy(rewards).to(self.device), done, extras


def settings(**changes):
    """Settings of rsl_rl's ``OnPolicyRunner`` as those of ``qv walk train``; ``changes`` are of the outermost ones."""
    network = {"class_name": "MLPModel", "hidden_dims": [64, 64], "activation": "elu"}
    actor = {**network, "distribution_cfg": {"class_name": "GaussianDistribution", "init_std": 1.0, "std_type": "scalar"}}
    learner = {
        "class_name": "PPO",
        "num_learning_epochs": 4,
        "num_mini_batches": 8,
        "clip_param": 0.2,
        "gamma": 0.99,
        "lam": 0.95,
        "entropy_coef": 0.002,
        "value_loss_coef": 1.0,
        "use_clipped_value_loss": True,
        "learning_rate": 1e-3,
        "max_grad_norm": 1.0,
        "schedule": "adaptive",
        "desired_kl": 0.02,
    }
    return {
        "num_steps_per_env": 24,
        "save_interval": 100,
        "obs_groups": {"actor": ["policy"], "critic": ["privileged"]},
        "actor": actor,
        "critic": network,
        "algorithm": learner,
        **changes,
    }
