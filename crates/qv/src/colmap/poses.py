"""Where photographs were taken: COLMAP's features and matches, its global mapper, and its incremental one where that fails.

    python poses.py IMAGES FOLDER [GIVEN]

GIVEN is a JSON of lenses to begin with, which images each took, and the images' poses; without it all are of one unknown lens.
Writes FOLDER/sparse/0. Says what it does, a line for each stage, and at last a line of JSON.

With "check" in GIVEN it first looks how many of the verified matches the given poses explain; if nearly all, it looks for none.
"""

import json
import pathlib
import shutil
import sys

import numpy as np
import pycolmap

# With no more frames than this, each is matched with each: of a video, and of photographs in no order.
ALL_PAIRS = {"video": 60, "photographs": 200}
# Otherwise with so many after it, and with those 2, 4, 8, ... after it.
NEXT = 10
# Fewest verified matches of a pair that counts.
FEW = 15
# A right model holds about nine in ten of the verified matches, one with a part that lies wrong seven.
NEARLY_ALL = 0.85
# Distance from its epipolar line at which poses explain a match: twice what features are off by [px].
NOISE = 2.0
# Given poses that explain this share of the verified matches are good: others would not be looked for.
GOOD = 0.9


def say(stage):
    print(stage, flush=True)


def matched(database, count, kind):
    if count <= ALL_PAIRS[kind]:
        pycolmap.match_exhaustive(database)
        return
    pairing = pycolmap.SequentialPairingOptions()
    pairing.overlap = NEXT
    pairing.quadratic_overlap = True
    pycolmap.match_sequential(database, pairing_options=pairing)


def featured(database, images, camera):
    reader = pycolmap.ImageReaderOptions()
    reader.camera_model = camera["model"]
    reader.camera_params = ",".join(str(x) for x in camera["params"])
    pycolmap.extract_features(
        database, images, camera["images"], camera_mode=pycolmap.CameraMode.SINGLE, reader_options=reader
    )


def verified(database):
    """Numbers of two images, and the matches between them that COLMAP verified, where there are enough."""
    for pair, geometry in zip(*database.read_two_view_geometries()):
        matches = geometry.inlier_matches
        if len(matches) >= FEW:
            yield pycolmap.pair_id_to_image_pair(pair), matches


def held(database, model):
    """Share of the verified matches that the model holds: whose two features are one point of it.

    A model of which one part lies wrong against the other has small reprojection errors all the same; the matches between the
    parts are what it lacks.
    """
    same, total = 0, 0
    for (a, b), matches in verified(database):
        total += len(matches)
        if a not in model.images or b not in model.images:
            continue
        first, second = ([p.point3D_id if p.has_point3D() else -1 for p in model.images[k].points2D] for k in (a, b))
        same += sum(1 for i, j in matches if first[i] >= 0 and first[i] == second[j])
    return same / max(total, 1)


def explained(database, camera_of, pose_of):
    """Share of the verified matches that lie within NOISE of their epipolar lines (Sampson's distance, Hartley and Zisserman 2004, 11.4.3).

    `camera_of` and `pose_of` give a lens, and rotation and translation from the world, by the number of an image, or none. Matches of
    images without a pose are not explained. Of two photographs from one place a match is explained where its ray is the same.
    """
    good, total = 0, 0
    for pair, matches in verified(database):
        total += len(matches)
        if any(pose_of(k) is None for k in pair):
            continue
        rays = []
        for side, k in enumerate(pair):
            points = np.asarray(database.read_keypoints(k))[matches[:, side], :2].astype(float)
            flat = np.asarray(camera_of(k).cam_from_img(points))
            rays.append(np.column_stack([flat, np.ones(len(flat))]))
        focal = 0.5 * sum(camera_of(k).mean_focal_length() for k in pair)
        (first, from_first), (second, from_second) = (pose_of(k) for k in pair)
        turn = second @ first.T
        shift = from_second - turn @ from_first
        good += int((residuals(turn, shift, *rays) * focal < NOISE).sum())
    return good / max(total, 1)


def residuals(turn, shift, a, b):
    """Sampson's distances of rays with z = 1 in two photographs, in units of the focal length; infinite behind one of the two."""
    length = np.linalg.norm(shift)
    moved = a @ turn.T
    if length < 1e-9:
        with np.errstate(divide="ignore", invalid="ignore"):
            off = np.linalg.norm(moved[:, :2] / moved[:, 2:] - b[:, :2], axis=1)
        return np.where(moved[:, 2] > 0, off, np.inf)
    x, y, z = shift / length
    essential = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]]) @ turn
    lines, back = a @ essential.T, b @ essential
    slope = lines[:, 0] ** 2 + lines[:, 1] ** 2 + back[:, 0] ** 2 + back[:, 1] ** 2
    off = np.abs((lines * b).sum(axis=1)) / np.sqrt(np.maximum(slope, 1e-30))
    # Depths along both rays are positive: d1 (turn a) + shift = d2 b.
    cross = np.cross(moved, b)
    square = np.maximum((cross**2).sum(axis=1), 1e-30)
    first = -(np.cross(shift, b) * cross).sum(axis=1) / square
    second = -(np.cross(shift, moved) * cross).sum(axis=1) / square
    return np.where((first > 0) & (second > 0), off, np.inf)


def lens(camera, size):
    """A lens of GIVEN."""
    return pycolmap.Camera(model=camera["model"], width=size[0], height=size[1], params=camera["params"])


def given_explain(database, given):
    """Share of the verified matches that the given poses and lenses explain."""
    images = {image.name: image for image in database.read_all_images()}
    lenses, poses = {}, {}
    for camera in given["cameras"]:
        for name in camera["images"]:
            if name not in images:
                continue
            known = database.read_camera(images[name].camera_id)
            lenses[images[name].image_id] = lens(camera, (known.width, known.height))
            rows = np.array(given["poses"][name]).reshape(3, 4)
            poses[images[name].image_id] = (rows[:, :3], rows[:, 3])
    return explained(database, lenses.get, poses.get)


def found_explain(database, model):
    """The same of a model."""

    def pose(k):
        if k not in model.images or not model.images[k].has_pose:
            return None
        rows = model.images[k].cam_from_world().matrix()
        return rows[:, :3], rows[:, 3]

    return explained(database, lambda k: model.cameras[model.images[k].camera_id], pose)


def mapped(path, images, folder):
    """The best model, what it holds of the matches, and by which mapper; the global one's if that holds nearly all, else the better of two."""
    options = pycolmap.GlobalPipelineOptions()
    options.random_seed = 0
    mappers = {
        "global": lambda: pycolmap.global_mapping(path, images, folder / "global", options),
        "incremental": lambda: pycolmap.incremental_mapping(path, images, folder / "incremental"),
    }
    database = pycolmap.Database.open(path)
    found = []
    for name, mapper in mappers.items():
        say(f"finding poses, {name} mapper")
        (folder / name).mkdir(exist_ok=True)
        models = mapper()
        if models:
            model = max(models.values(), key=lambda model: model.num_reg_images())
            found.append((held(database, model), model, name))
        if found and found[-1][0] > NEARLY_ALL:
            break
    database.close()
    return max(found, key=lambda one: one[0], default=(0.0, None, "none"))


def main():
    images, folder = pathlib.Path(sys.argv[1]), pathlib.Path(sys.argv[2])
    database = folder / "database.db"
    database.unlink(missing_ok=True)
    pycolmap.logging.minloglevel = 2
    pycolmap.set_random_seed(0)
    if len(sys.argv) > 3:
        given = json.loads(pathlib.Path(sys.argv[3]).read_text())
        kind, cameras = "photographs", given["cameras"]
    else:
        given = {}
        kind, cameras = "video", [{"model": "OPENCV", "params": [], "images": sorted(p.name for p in images.iterdir())}]
    count = sum(len(camera["images"]) for camera in cameras)
    say(f"looking for features in {count} photographs")
    for camera in cameras:
        featured(database, images, camera)
    say("matching photographs")
    matched(database, count, kind)
    of_given = None
    if given.get("poses"):
        opened = pycolmap.Database.open(database)
        of_given = given_explain(opened, given)
        opened.close()
        if given.get("check") and of_given >= GOOD:
            print(json.dumps({"frames": count, "placed": 0, "held": 0.0, "given_explain": of_given}), flush=True)
            return
    share, model, mapper = mapped(database, images, folder)
    found = {"frames": count, "placed": 0, "mapper": mapper, "held": share, "given_explain": of_given}
    if model is not None:
        target = folder / "sparse" / "0"
        shutil.rmtree(target, ignore_errors=True)
        target.mkdir(parents=True)
        model.write(target)
        found["placed"] = model.num_reg_images()
        found["points"] = model.num_points3D()
        found["reprojection_px"] = model.compute_mean_reprojection_error()
        if of_given is not None:
            opened = pycolmap.Database.open(database)
            found["found_explain"] = found_explain(opened, model)
            opened.close()
    print(json.dumps(found), flush=True)


main()
