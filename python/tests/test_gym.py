"""The velocity task under gymnasium."""

import subprocess
import sys

import numpy as np
import pytest

from quadverse import VelocityEnv


def test_spaces_steps_and_resets():
    env = VelocityEnv(8, seed=3)
    observations, info = env.reset(seed=3)
    assert observations.shape == (8, 47) and env.observation_space.contains(observations) and info == {}
    random, ended = np.random.default_rng(1), 0
    for _ in range(120):
        actions = random.normal(0, 4, env.action_space.shape).astype(np.float32)
        observations, rewards, failed, over, info = env.step(actions)
        assert rewards.shape == failed.shape == over.shape == (8,)
        assert np.isfinite(observations).all() and np.isfinite(rewards).all()
        if (failed | over).any():
            ended += 1
            which = info["_final_obs"]
            assert not np.array_equal(info["final_obs"][which], observations[which])
            assert np.array_equal(which, failed | over)
    # Wild targets throw robots over.
    assert ended > 0


def test_a_seed_gives_the_same_bits():
    def rolled():
        env = VelocityEnv(4)
        first, _ = env.reset(seed=11)
        return [first, *env.step(np.zeros((4, 12)))[:2]]

    for one, other in zip(rolled(), rolled()):
        assert np.array_equal(one, other)


def test_an_action_that_is_no_number_is_named():
    env = VelocityEnv(3)
    env.reset(seed=1)
    actions = np.zeros(env.action_space.shape, np.float32)
    actions[2, 5] = np.nan
    with pytest.raises(ValueError, match=r"actions\[2, 5\]: expected a finite number, found NaN"):
        env.step(actions)


def test_a_package_that_is_not_there_is_named_with_how_to_get_it():
    code = "import sys; sys.modules['gymnasium'] = None; import quadverse; quadverse.VelocityEnv"
    # `None` makes an import fail as if there were no such package.
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert found.returncode == 1
    assert "expected the package gymnasium (pip install gymnasium), found none" in found.stderr
