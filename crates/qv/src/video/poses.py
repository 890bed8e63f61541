"""Where the frames of a video were taken: COLMAP's features and matches, its global mapper, else its incremental one.

    python poses.py IMAGES FOLDER

Writes FOLDER/sparse/0. Says what it does, a line for each stage, and at last a line of JSON.
"""

import json
import pathlib
import shutil
import sys

import pycolmap

# With no more frames than this, each is matched with each.
ALL_PAIRS = 60
# Otherwise with so many after it, and with those 2, 4, 8, ... after it.
NEXT = 10


def say(stage):
    print(stage, flush=True)


def matched(database, count):
    if count <= ALL_PAIRS:
        pycolmap.match_exhaustive(database)
        return
    pairing = pycolmap.SequentialPairingOptions()
    pairing.overlap = NEXT
    pairing.quadratic_overlap = True
    pycolmap.match_sequential(database, pairing_options=pairing)


def mapped(database, images, folder):
    """The models that were found, and by which mapper."""
    options = pycolmap.GlobalPipelineOptions()
    options.random_seed = 0
    models = pycolmap.global_mapping(database, images, folder / "global", options)
    if models:
        return models, "global"
    say("finding poses one by one")
    return pycolmap.incremental_mapping(database, images, folder / "incremental"), "incremental"


def main():
    images, folder = pathlib.Path(sys.argv[1]), pathlib.Path(sys.argv[2])
    count = sum(1 for _ in images.iterdir())
    database = folder / "database.db"
    database.unlink(missing_ok=True)
    pycolmap.logging.minloglevel = 2
    pycolmap.set_random_seed(0)
    reader = pycolmap.ImageReaderOptions()
    reader.camera_model = "OPENCV"
    say(f"looking for features in {count} frames")
    pycolmap.extract_features(database, images, camera_mode=pycolmap.CameraMode.SINGLE, reader_options=reader)
    say("matching frames")
    matched(database, count)
    say("finding poses")
    for name in ["global", "incremental"]:
        (folder / name).mkdir(exist_ok=True)
    models, mapper = mapped(database, images, folder)
    found = {"frames": count, "placed": 0, "models": len(models), "mapper": mapper}
    if models:
        best = max(models.values(), key=lambda model: model.num_reg_images())
        target = folder / "sparse" / "0"
        shutil.rmtree(target, ignore_errors=True)
        target.mkdir(parents=True)
        best.write(target)
        found["placed"] = best.num_reg_images()
        found["points"] = best.num_points3D()
        found["reprojection_px"] = best.compute_mean_reprojection_error()
    print(json.dumps(found), flush=True)


main()
