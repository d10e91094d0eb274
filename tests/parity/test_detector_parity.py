"""The released CoIn3D detector, stage by stage, on weights and images generated from names: two frames, both test rigs."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from typing import Any

import numpy as np
import pytest
import torch
from parity_files import filler, fixture, released_weights
from torch import Tensor

from coin3d.detectors import Batch, BEVDepth
from coin3d.geometry.camera_tensors import CameraTensors
from coin3d.methods.coin3d import CoIn3D
from coin3d.priors.released import ReleasedConventions
from coin3d.training.released.coin3d_keys import COIN3D_KEYS, released_config, released_options

HEADS = {"reg": "offset", "height": "height", "dim": "size", "rot": "heading", "heatmap": "heatmap"}

# file, moment of the rays, how the frame before comes, gains of the weights
CASES = [
    ("coin3d_det_nus6_128x352", "ego_in_cam", "warp", "COIN3D_GAIN"),
    ("coin3d_det_nus6_trainpath_128x352", "ego_in_cam", "pose", "COIN3D_GAIN"),
    ("coin3d_det_waymo5_b2_128x352", "cam_in_ego", "warp", "COIN3D_GAIN_W"),
]


@lru_cache(maxsize=1)
def weights(gain: str) -> dict[str, Tensor]:
    return released_weights("coin3d_bevdet_keys.txt", gain=getattr(filler(), gain))


def detector(moment: Any, previous_by: Any) -> BEVDepth:
    conventions = ReleasedConventions(moment=moment)
    config = replace(released_config(conventions), image_width_px=352, image_height_px=128, previous_by=previous_by)
    return BEVDepth(config, ("car",), CoIn3D(released_options(conventions))).eval()


def frame(stored: dict[str, np.ndarray], images: Tensor, which: int, previous: Batch | None = None) -> Batch:
    """Key frame (0) or the one before (1) of all samples as our batch."""
    samples, both = stored["K"].shape[:2]
    cameras = both // 2
    rows = slice(which * cameras, (which + 1) * cameras)

    def flat(name: str) -> np.ndarray:
        values = stored[name][:, rows].astype(np.float64)
        return values.reshape(-1, *values.shape[2:])

    height, width = stored["size"].tolist()
    augment = flat("post_rot").copy()
    augment[:, :, 2] += flat("post_tran")
    half = np.eye(3)
    half[:2, 2] = 0.5  # their pixels are whole numbers
    world_from_key = np.repeat(stored["ego2global"][:, 0].astype(np.float64), cameras, axis=0)
    ground = np.tile([0.0, 0.0, 1.0, 0.0], (samples * cameras, 1))
    # their augmentation of the ground plane also shifts; ours does not, so the shift goes before it
    shift = np.tile(np.eye(4), (samples, 1, 1))
    bda = stored["bda"].astype(np.float64)
    shift[:, :3, 3] = np.linalg.solve(bda[:, :3, :3], bda[:, :3, 3:])[..., 0]
    moved = np.repeat(shift, cameras, axis=0) @ np.linalg.inv(world_from_key) @ flat("ego2global")
    tensors = [half @ augment @ flat("K"), flat("sensor2ego"), ground, moved]
    K, ego_from_cam, planes, key_from_ego = (torch.from_numpy(value).float() for value in tensors)
    return Batch(
        images[:, which::2].reshape(-1, 3, height, width),
        CameraTensors(K, ego_from_cam, planes, height, width),
        torch.arange(samples).repeat_interleave(cameras),
        torch.from_numpy(stored["bda"][:, :3, :3]).float(),
        key_from_ego=key_from_ego,
        previous=previous,
    )


class Stages:
    """What modules return, call by call: the key frame first, then the one before."""

    def __init__(self, model: BEVDepth) -> None:
        self.outputs: dict[str, list[Any]] = {}
        named = {
            "backbone": model.backbone,
            "m16": model.method.modulations["backbone_16"],
            "m32": model.method.modulations["backbone_32"],
            "neck": model.neck,
            "mneck": model.method.modulations["neck"],
            "depth_net": model.depth_net,
            "frame": model.frame_encoder,
            "enc": model.bev_encoder,
            **{f"enc_bb{i}": stage for i, stage in enumerate(model.bev_encoder.stages)},
        }
        for name, module in named.items():
            module.register_forward_hook(lambda _m, inputs, out, name=name: self._keep(name, inputs, out))

    def _keep(self, name: str, inputs: Any, out: Any) -> None:
        self.outputs.setdefault(name, []).append(out)
        self.outputs.setdefault(f"{name} in", []).append(inputs)


def error(ours: Tensor, theirs: np.ndarray) -> Tensor:
    expected = torch.from_numpy(theirs)
    assert ours.shape == expected.shape
    return (ours - expected).abs() / expected.abs().max()


def thinned(ours: Tensor, theirs: np.ndarray) -> Tensor:
    """The rows, columns and channels of a BEV map that a fixture keeps."""
    step = ours.shape[-1] // theirs.shape[-1]
    if step == 2:
        ours = ours[..., 1::2, 0::2]
    return ours[:, :: ours.shape[1] // theirs.shape[1]]


@pytest.mark.parametrize(("name", "moment", "previous_by", "gain"), CASES)
def test_every_stage(name: str, moment: str, previous_by: str, gain: str) -> None:
    stored, generated = fixture(f"{name}.npz"), filler()
    model = detector(moment, previous_by)
    model.load_state_dict(COIN3D_KEYS.convert(weights(gain), model.state_dict()))
    samples, both = stored["K"].shape[:2]
    tag = name.removeprefix("coin3d_det_")
    images = generated.randn(f"coin3d_img_{tag}", samples, both, 3, *stored["size"].tolist())
    batch = frame(stored, images, 0, frame(stored, images, 1))
    stages = Stages(model)
    with torch.inference_mode():
        outputs = model(batch)
    seen = stages.outputs
    for call, when in enumerate(("key", "prev")):
        views = {
            "c4": seen["backbone"][call][0],
            "c5": seen["backbone"][call][1],
            "neck": seen["neck"][call],
            "m16": seen["m16"][call],
            "m32": seen["m32"][call],
            "mneck": seen["mneck"][call],
            "context": seen["depth_net"][call][1],
            "depth": seen["depth_net"][call][0].softmax(1),
        }
        prior = seen["m16"][call][:, -9:]
        assert (prior - torch.from_numpy(stored[f"prior16_{when}"])).abs().max() < 1e-4
        for stage, ours in views.items():
            theirs = stored[f"{stage}_{when}"]
            step = 2 ** round(np.log2(ours.shape[1] / theirs.shape[1]))  # concatenated priors make channels uneven
            assert error(ours[:, ::step], theirs).max() < 2e-5, f"{stage} of the {when} frame"
        for stage, ours in (("bev", seen["frame in"][call][0]), ("pre", seen["frame"][call])):
            off = error(thinned(ours, stored[f"{stage}_{when}"]), stored[f"{stage}_{when}"])
            assert off.max() < 5e-3 and (off > 1e-4).float().mean() < 1e-3, f"{stage} of the {when} frame"
    joined = seen["enc in"][0][0]
    later = {"enc": seen["enc"][0], **{f"enc_bb{i}": seen[f"enc_bb{i}"][0] for i in range(3)}}
    if "warp_prev" in stored:
        later["warp_prev"] = joined[:, joined.shape[1] // 2 :]
    for stage, ours in later.items():
        off = error(thinned(ours, stored[stage]), stored[stage])
        assert off.max() < 5e-3 and (off > 1e-4).float().mean() < 1e-3, stage
    for theirs, mine in HEADS.items():
        assert error(outputs[mine], stored[f"head_{theirs}"]).max() < 5e-4, theirs


def test_without_a_frame_before_its_place_is_zero() -> None:
    stored, generated = fixture("coin3d_det_nus6_128x352.npz"), filler()
    model = detector("ego_in_cam", "warp")
    model.load_state_dict(COIN3D_KEYS.convert(weights("COIN3D_GAIN"), model.state_dict()))
    images = generated.randn("coin3d_img_nus6_128x352", 1, 12, 3, 128, 352)
    with torch.inference_mode():
        outputs = model(frame(stored, images, 0))
    assert error(outputs["heatmap"], stored["noprev_heatmap"]).max() < 5e-4
    assert error(outputs["offset"][..., ::2, ::2], stored["noprev_reg"]).max() < 5e-4
