"""rsl_rl trains the velocity task; needs torch, so that only `cargo xtask python --rsl-rl` runs it."""

import pytest

torch = pytest.importorskip("torch", reason="torch is installed by `cargo xtask python --rsl-rl`")
pytest.importorskip("rsl_rl", reason="rsl_rl is installed by `cargo xtask python --rsl-rl`")

from rsl_rl.runners import OnPolicyRunner  # noqa: E402

from quadverse.rsl import VelocityVecEnv, settings  # noqa: E402


def test_shapes_and_resets():
    env = VelocityVecEnv(8, seed=2)
    seen = env.get_observations()
    assert seen["policy"].shape == (8, 47) and seen["privileged"].shape[1] > 47
    ended = 0
    for _ in range(120):
        seen, rewards, dones, extras = env.step(4 * torch.randn(8, env.num_actions))
        ended += int(dones.sum())
        assert not env.episode_length_buf[dones].any() and extras["time_outs"].shape == rewards.shape == (8,)
        assert torch.isfinite(seen["policy"]).all() and torch.isfinite(seen["privileged"]).all()
    assert ended > 0


def test_a_policy_learns_to_stay_up_and_follow():
    torch.manual_seed(1)
    env = VelocityVecEnv(256, seed=1)
    rewards = []
    step = env.step

    def counted(actions):
        result = step(actions)
        rewards.append(result[1].mean().item())
        return result

    env.step = counted
    runner = OnPolicyRunner(env, settings(), log_dir=None, device="cpu")
    runner.learn(100)
    first, last = sum(rewards[:240]) / 240, sum(rewards[-240:]) / 240
    assert last > first + 0.3 * abs(first), (first, last)

    # Without noise, robots stay up for three seconds.
    policy, env = runner.get_inference_policy("cpu"), VelocityVecEnv(64, seed=9)
    seen, fell = env.get_observations(), torch.zeros(64, dtype=torch.bool)
    with torch.inference_mode():
        for _ in range(150):
            seen, _, dones, extras = env.step(policy(seen))
            fell |= dones & ~extras["time_outs"]
    assert fell.float().mean() < 0.25, fell.float().mean()
