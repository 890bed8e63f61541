"""Where photographs were taken: COLMAP's features and matches, its global mapper, and its incremental one where that fails.

    python poses.py IMAGES FOLDER [GIVEN]

GIVEN is a JSON of lenses to begin with, and which images each took; without it all are of one unknown lens.
Writes FOLDER/sparse/0. Says what it does, a line for each stage, and at last a line of JSON.
"""

import json
import pathlib
import shutil
import sys

import pycolmap

# With no more frames than this, each is matched with each: of a video, and of photographs in no order.
ALL_PAIRS = {"video": 60, "photographs": 200}
# Otherwise with so many after it, and with those 2, 4, 8, ... after it.
NEXT = 10
# Fewest verified matches of a pair that counts.
FEW = 15
# A right model holds about nine in ten of the verified matches, one with a part that lies wrong seven.
NEARLY_ALL = 0.85


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


def held(database, model):
    """Share of the verified matches that the model holds: whose two features are one point of it.

    A model of which one part lies wrong against the other has small reprojection errors all the same; the matches between the
    parts are what it lacks.
    """
    same, total = 0, 0
    for pair, geometry in zip(*database.read_two_view_geometries()):
        matches = geometry.inlier_matches
        if len(matches) < FEW:
            continue
        total += len(matches)
        a, b = pycolmap.pair_id_to_image_pair(pair)
        if a not in model.images or b not in model.images:
            continue
        first, second = ([p.point3D_id if p.has_point3D() else -1 for p in model.images[k].points2D] for k in (a, b))
        same += sum(1 for i, j in matches if first[i] >= 0 and first[i] == second[j])
    return same / max(total, 1)


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
        kind, cameras = "photographs", json.loads(pathlib.Path(sys.argv[3]).read_text())["cameras"]
    else:
        kind, cameras = "video", [{"model": "OPENCV", "params": [], "images": sorted(p.name for p in images.iterdir())}]
    count = sum(len(camera["images"]) for camera in cameras)
    say(f"looking for features in {count} photographs")
    for camera in cameras:
        featured(database, images, camera)
    say("matching photographs")
    matched(database, count, kind)
    share, model, mapper = mapped(database, images, folder)
    found = {"frames": count, "placed": 0, "mapper": mapper, "held": share}
    if model is not None:
        target = folder / "sparse" / "0"
        shutil.rmtree(target, ignore_errors=True)
        target.mkdir(parents=True)
        model.write(target)
        found["placed"] = model.num_reg_images()
        found["points"] = model.num_points3D()
        found["reprojection_px"] = model.compute_mean_reprojection_error()
    print(json.dumps(found), flush=True)


main()
