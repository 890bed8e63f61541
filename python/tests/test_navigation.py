"""The navigation task under gymnasium, in a yard of boxes that is made here."""

import json
import struct

import numpy as np
import pytest

import quadverse
from quadverse import NavigationEnv

#: Middle and half of the side of each box on the ground [m], height [m].
BOXES = [(-1.5, 0.5, 0.4, 0.7), (1.2, -1.4, 0.5, 0.8), (1.5, 1.8, 0.4, 0.7)]
#: Half of the yard's side [m].
HALF = 4.0


def glb(path, vertices, triangles):
    """A mesh as glTF in one file."""
    places, corners = np.asarray(vertices, "<f4"), np.asarray(triangles, "<u4")
    body = places.tobytes() + corners.tobytes()
    head = {
        "asset": {"version": "2.0"},
        "buffers": [{"byteLength": len(body)}],
        "bufferViews": [
            {"buffer": 0, "byteOffset": 0, "byteLength": places.nbytes},
            {"buffer": 0, "byteOffset": places.nbytes, "byteLength": corners.nbytes},
        ],
        "accessors": [
            {
                "bufferView": 0,
                "componentType": 5126,
                "count": len(places),
                "type": "VEC3",
                "min": places.min(0).tolist(),
                "max": places.max(0).tolist(),
            },
            {"bufferView": 1, "componentType": 5125, "count": corners.size, "type": "SCALAR"},
        ],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        # Our meshes have z up.
        "nodes": [{"mesh": 0}],
        "scenes": [{"nodes": [0]}],
        "scene": 0,
    }
    text = json.dumps(head).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<II", len(text), 0x4E4F534A) + text + struct.pack("<II", len(body), 0x004E4942) + body
    path.write_bytes(struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks)


def block(x, y, half, height):
    """Corners and triangles of a box that stands on the ground."""
    corners = [(x + half * a, y + half * b, height * c) for c in (0, 1) for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    sides = [(k, (k + 1) % 4, 4 + (k + 1) % 4, 4 + k) for k in range(4)]
    faces = [*sides, (4, 5, 6, 7)]
    return corners, [t for a, b, c, d in faces for t in ((a, b, c), (a, c, d))]


@pytest.fixture(scope="module")
def yard(tmp_path_factory):
    """A scene of Gaussians and the mesh of the same place."""
    vertices = [(x * HALF, y * HALF, 0.0) for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    triangles = [(0, 1, 2), (0, 2, 3)]
    random, means, colours = np.random.default_rng(5), [], []
    for box in BOXES:
        corners, faces = block(*box)
        triangles += [tuple(len(vertices) + k for k in face) for face in faces]
        vertices += corners
        x, y, half, height = box
        for _ in range(300):
            at = random.uniform(-half, half, 2)
            at[random.integers(2)] = half * random.choice([-1, 1])
            means.append((x + at[0], y + at[1], random.uniform(0, height)))
            colours.append((0.35, 0.3, 0.28))
    for _ in range(1500):
        means.append((*random.uniform(-HALF, HALF, 2), 0.0))
        colours.append((0.45, 0.5, 0.42))
    count = len(means)
    # The first harmonic is 1 / (2 sqrt(pi)).
    sh = (np.array(colours) - 0.5) / 0.28209479
    scene = quadverse.cloud(means, np.full((count, 3), np.log(0.08)), [[1, 0, 0, 0]] * count, np.full(count, 3.0), sh)
    path = tmp_path_factory.mktemp("yard") / "yard.glb"
    glb(path, vertices, triangles)
    return scene, path


def follower(observation):
    """Goes to the wanted colour, and turns to the left where there is none: no learning."""
    picture, state = observation["picture"].astype(float), observation["state"]
    red, green, blue = np.moveaxis(picture, -1, 0)
    wanted = [
        (red > 1.9 * green) & (red > 1.9 * blue),
        (blue > 1.6 * red) & (blue > 1.35 * green),
        (red > 2.2 * blue) & (green > 1.6 * blue),
    ]
    actions = np.zeros((len(state), 3), np.float32)
    for env, row in enumerate(state):
        mask = wanted[int(row[:3].argmax())][env]
        # A share of -0.5 is a speed of zero.
        if mask.sum() < 4:
            actions[env] = [-0.5, 0.0, 0.8]
            continue
        column = np.nonzero(mask)[1].mean()
        turn = (40 - column) / 40
        near = mask[-1].any() and mask.sum() > 800
        actions[env] = [-0.5 if near else 0.7 - abs(turn), 0.0, turn]
    return actions


def test_spaces_ends_and_resets(yard):
    scene, mesh = yard
    env = NavigationEnv(6, scene, mesh, seed=3)
    observation, info = env.reset(seed=3)
    assert env.observation_space.contains(observation) and info == {}
    assert observation["picture"].shape == (6, 60, 80, 3) and observation["picture"].std() > 10
    kinds = [env.task.episode(k)[2] for k in range(6)]
    assert kinds == ["in view", "out of the picture", "hidden"] * 2
    ends, actions = [], np.tile(np.array([1, 0, 0], np.float32), (6, 1))
    for _ in range(60):
        before = [env.task.episode(k)[1] for k in range(6)]
        observation, rewards, failed, over, info = env.step(actions)
        assert rewards.shape == failed.shape == over.shape == (6,) and np.isfinite(rewards).all()
        for k in np.nonzero(failed | over)[0]:
            ends.append(info["end"][k])
            assert rewards[k] < -1 and env.task.episode(k)[1] != before[k]
            assert not np.array_equal(info["final_obs"]["picture"][k], observation["picture"][k])
    # Straight on runs into something.
    assert len(ends) >= 6 and set(ends) <= {"collision", "cone pushed"}


def test_a_follower_of_colours_reaches_goals_and_gains_reward(yard):
    scene, mesh = yard
    env = NavigationEnv(8, scene, mesh, camera="none", goals=["in_view"])
    observation, _ = env.reset(seed=1)
    ends, paid = [], 0.0
    for _ in range(150):
        observation, rewards, failed, over, info = env.step(follower(observation))
        paid += rewards.sum()
        ends += [info["end"][k] for k in np.nonzero(failed | over)[0]]
    assert ends.count("reached") >= 4 and paid > 20, ends


def test_a_scene_is_drawn_over_what_it_was_made_over(yard, tmp_path):
    several = {"f_dc": 3, "opacity": 0, "scale": 3, "rot": 4}
    names = [*"xyz", *(f"{name}_{k}" if n else name for name, n in several.items() for k in range(max(n, 1)))]
    # One small Gaussian, below the ground.
    numbers = np.array([0, 0, -9, 0, 0, 0, 4, -3, -3, -3, 1, 0, 0, 0], "<f4")

    def corner(background):
        comment = f"comment background {background}\n" if background else ""
        properties = "".join(f"property float {name}\n" for name in names)
        header = f"ply\nformat binary_little_endian 1.0\n{comment}element vertex 1\n{properties}end_header\n"
        path = tmp_path / "scene.ply"
        path.write_bytes(header.encode() + numbers.tobytes())
        env = NavigationEnv(2, path, yard[1], camera="none", goals=["in_view"])
        return env.reset(seed=1)[0]["picture"][0, 0, 0].astype(int)

    red, nothing, black = corner("0.8 0.2 0.1"), corner(""), corner("0 0 0")
    assert np.abs(red - [204, 51, 26]).max() <= 2, red
    # A sky.
    assert np.array_equal(nothing, black) and nothing[2] > nothing[0] > 150, nothing


def test_a_seed_gives_the_same_bits(yard):
    def rolled():
        env = NavigationEnv(3, *yard, hidden_effects=True)
        first, _ = env.reset(seed=11)
        second, rewards, *_ = env.step(np.full((3, 3), 0.5))
        return [first["picture"], first["state"], second["picture"], rewards]

    for one, other in zip(rolled(), rolled()):
        assert np.array_equal(one, other)


def test_bad_input_is_named(yard):
    scene, mesh = yard
    with pytest.raises(ValueError, match="camera: expected wide or none, found fish"):
        NavigationEnv(1, scene, mesh, camera="fish")
    with pytest.raises(ValueError, match="goals: expected in_view, turned or hidden, found lost"):
        NavigationEnv(1, scene, mesh, goals=["lost"])
    with pytest.raises(OSError, match="none.glb"):
        NavigationEnv(1, scene, mesh.with_name("none.glb"))
    env = NavigationEnv(2, scene, mesh)
    with pytest.raises(ValueError, match="expected the shape"):
        env.step(np.zeros((2, 2)))
