"""The velocity task under gymnasium."""

import numpy as np

from quadverse import VelocityEnv


def test_spaces_steps_and_resets():
    env = VelocityEnv(8, seed=3)
    observations, info = env.reset(seed=3)
    assert observations.shape == (8, 45) and env.observation_space.contains(observations) and info == {}
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
