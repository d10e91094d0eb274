"""The released BEVFormer-tiny with weights generated from their names, loaded as a real file would be."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import torch
from parity_files import filler, released_weights

from coin3d.detectors import Batch, Method
from coin3d.detectors.bevformer import BEVFormer
from coin3d.detectors.bevformer_config import BEVFormerConfig
from coin3d.detectors.released_bevformer import ReleasedBevFormer
from coin3d.geometry.camera_tensors import CameraTensors
from coin3d.training.released.bevformer_keys import BEVFORMER_KEYS, bevformer_in_our_coding

HEADINGS_DEG = (0.0, -55.0, 55.0, 180.0, -125.0, 125.0)  # of the fixture's cameras, whose last two are not as nuScenes has them
CONFIG = replace(
    BEVFormerConfig.released_nuscenes(),
    image_width_px=160,
    image_height_px=96,
    released=ReleasedBevFormer(camera_headings_deg=HEADINGS_DEG),
)
CLASSES = tuple("abcdefghij")
KEY_LIST = "bevformer_keys.txt"


@cache
def released_model() -> BEVFormer:
    with torch.device("meta"):
        model = BEVFormer(CONFIG, CLASSES, Method())
    weights = BEVFORMER_KEYS.convert(released_weights(KEY_LIST), model.state_dict())
    model.load_state_dict(bevformer_in_our_coding(weights), assign=True)
    return model.eval()


def released_batch(lidar2img: np.ndarray) -> Batch:
    """The fixture's noise images and cameras, whose matrices point from the LiDAR frame into images counted from 0."""
    assert CONFIG.released is not None
    K = np.array([[72.0, 0, 80], [0, 72, 48], [0, 0, 1]])  # 0.45 of the width, principal point in the middle
    cam_from_lidar = np.tile(np.eye(4), (6, 1, 1))
    cam_from_lidar[:, :3] = np.linalg.inv(K) @ lidar2img[:, :3]
    ours = K.copy()
    ours[:2, 2] += 0.5 - CONFIG.released.first_pixel
    ego_from_cam = CONFIG.released.lidar.ego_from_lidar.matrix @ np.linalg.inv(cam_from_lidar)
    cameras = CameraTensors(
        torch.from_numpy(np.tile(ours, (6, 1, 1))).float(),
        torch.from_numpy(ego_from_cam).float(),
        torch.tensor([0.0, 0, 1, 0]).expand(6, 4),
        96,
        160,
    )
    return Batch(filler().randn("bevformer_img", 6, 3, 96, 160), cameras, torch.zeros(6, dtype=torch.long), torch.eye(3)[None])
