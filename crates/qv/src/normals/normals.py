"""Normals of photographs by a model in ONNX.

    python normals.py MODEL TASK

TASK is a JSON: {"images": [[PHOTOGRAPH, PNG], ...], "axes": ["x", "-y", "-z"], "colours": "imagenet" | "unit" | "bytes"}. The model takes an
image as [1, 3, H, W] and gives [1, 3, h, w] (or [1, h, w, 3]): normals in any length. Writes each PNG in the photograph's size, -1 to 1 as 0
to 255 in the axes of the camera (x right, y down, z forward). Says how far it is, and at last a line of JSON: the share of pixels whose normal
is turned to the camera.
"""

import json
import pathlib
import sys

import numpy as np
import onnxruntime
from PIL import Image

# Sides of models that take any size are multiples of this, and at most so long.
STEP, LONGEST = 32, 1024
# Means and deviations of red, green, blue.
IMAGENET = np.array([0.485, 0.456, 0.406]), np.array([0.229, 0.224, 0.225])


def side(wanted, own, shrink):
    """A side of the image that the model gets: its own where it is fixed."""
    if isinstance(own, int) and own > 0:
        return own
    return max(STEP, round(wanted * shrink / STEP) * STEP)


def coloured(image, colours):
    pixels = np.asarray(image, np.float32)
    if colours == "bytes":
        return pixels
    pixels = pixels / 255.0
    return (pixels - IMAGENET[0]) / IMAGENET[1] if colours == "imagenet" else pixels


def of_axes(normals, axes):
    """Each of our axes is one of the model's, or its opposite."""
    return np.stack([normals[..., "xyz".index(axis[-1])] * (-1 if axis[0] == "-" else 1) for axis in axes], -1)


def normals_of(session, image, colours):
    entry = session.get_inputs()[0]
    if len(entry.shape) != 4:
        sys.exit(f"expected a model that takes [1, 3, H, W], found {entry.shape}")
    shrink = min(1.0, LONGEST / max(image.size))
    height, width = (side(x, own, shrink) for x, own in zip(image.size[::-1], entry.shape[2:]))
    small = image.resize((width, height), Image.Resampling.BILINEAR)
    tensor = coloured(small, colours).astype(np.float32).transpose(2, 0, 1)[None]
    found = np.asarray(session.run(None, {entry.name: tensor})[0])
    if found.ndim == 4 and found.shape[1] == 3:
        found = found.transpose(0, 2, 3, 1)
    if found.ndim != 4 or found.shape[-1] != 3:
        sys.exit(f"expected normals as [1, 3, h, w], found {list(found.shape)}")
    channels = [Image.fromarray(found[0, ..., k].astype(np.float32)).resize(image.size, Image.Resampling.BILINEAR) for k in range(3)]
    return np.stack([np.asarray(channel) for channel in channels], -1)


def main():
    model, task = sys.argv[1], json.loads(pathlib.Path(sys.argv[2]).read_text())
    session = onnxruntime.InferenceSession(model, providers=onnxruntime.get_available_providers())
    facing, total = 0, 0
    for index, (photograph, png) in enumerate(task["images"]):
        print(f"normals of photograph {index + 1} of {len(task['images'])}", flush=True)
        normals = of_axes(normals_of(session, Image.open(photograph).convert("RGB"), task["colours"]), task["axes"])
        length = np.linalg.norm(normals, axis=-1, keepdims=True)
        there = np.isfinite(length) & (length > 1e-6)
        unit = np.where(there, normals / np.where(there, length, 1.0), 0.0)
        facing += int((unit[..., 2] < 0).sum())
        total += int(there.sum())
        bytes_ = np.where(there, np.clip(np.round((unit + 1.0) * 127.5), 1, 255), 0).astype(np.uint8)
        Image.fromarray(bytes_).save(png)
    print(json.dumps({"facing": facing / max(total, 1), "pixels": total}), flush=True)


main()
