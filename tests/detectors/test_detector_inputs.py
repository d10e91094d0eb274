"""From frames to batches, and the first convolution that reads more than RGB."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from torch import nn

from coin3d.detectors import collate, frame_sample
from coin3d.detectors.backbone import ImageBackbone
from coin3d.detectors.batch import normalise_image
from coin3d.detectors.widened_conv import WidenedConv2d
from coin3d.geometry import Pose, fit_width
from small_world import CONFIG, frame, ring_rig, sample


def test_normalisation_by_hand() -> None:
    image = np.array([[[255, 0, 128]]], dtype=np.uint8)
    expected = [(1 - 0.485) / 0.229, -0.456 / 0.224, (128 / 255 - 0.406) / 0.225]
    np.testing.assert_allclose(normalise_image(image).flatten(), expected, rtol=1e-6)


def test_rigs_of_different_size_are_flattened_without_ghosts() -> None:
    first, second = sample(0, ring_rig(3)), sample(1, ring_rig(5))
    turned = replace(second, bev_from_ego=np.diag([-1.0, 1.0, 1.0]))
    both = collate([first, turned])
    assert both.num_samples == 2
    assert both.sample_index.tolist() == [0, 0, 0, 1, 1, 1, 1, 1]
    assert both.images.shape == (8, 3, 64, 96) and len(both.cameras) == 8
    assert torch.equal(both.images[3:], collate([second]).images)
    assert torch.equal(both.cameras.K[3:], collate([second]).cameras.K)
    assert both.depth_m is not None and second.depth_m is not None
    assert torch.equal(both.depth_m[3:], torch.from_numpy(second.depth_m))
    assert both.bev_from_ego[1].tolist() == [[-1, 0, 0], [0, 1, 0], [0, 0, 1]]
    assert both.boxes == (first.boxes, second.boxes)


def test_depth_and_boxes_are_all_or_none() -> None:
    whole, bare = sample(0, ring_rig(2)), frame_sample(frame(1, ring_rig(2)), 96, 64)
    mixed = collate([whole, bare])
    assert mixed.depth_m is None and mixed.boxes == ()


def test_a_frame_becomes_input_by_the_image_rule() -> None:
    rig = ring_rig(2, size_px=(160, 120))
    f = frame(0, rig)
    taken = frame_sample(f, 96, 64)
    assert taken.images.shape == (2, 64, 96, 3) and taken.depth_m is None and taken.boxes is None
    for i, (name, camera) in enumerate(rig.items()):
        rule = fit_width(camera, 96, 64)
        np.testing.assert_array_equal(taken.images[i], rule.image(f.image(name)))
        np.testing.assert_allclose(taken.cameras[i].K, rule.camera(camera).K)
    assert taken.bev_from_ego.tolist() == np.eye(3).tolist()


def test_different_image_sizes_are_refused() -> None:
    small, large = sample(0, ring_rig(2)), frame_sample(frame(1, ring_rig(2)), 160, 64)
    with pytest.raises(ValueError, match="exactly one image size"):
        collate([small, large])


def test_wider_input_ignores_what_its_new_weights_ignore() -> None:
    torch.manual_seed(0)
    conv = nn.Conv2d(3, 8, 7, 2, 3, bias=True)
    wide = WidenedConv2d(conv, 9)
    assert wide.weight.shape == (8, 12, 7, 7)
    assert torch.equal(wide.weight[:, :3], conv.weight)
    # the new slice is not made of edge filters: another one, and small as PyTorch initialises 12 input channels
    assert 0 < float(wide.weight[:, 3:].detach().abs().max()) <= 1 / np.sqrt(12 * 49)
    image, maps = torch.randn(2, 3, 16, 16), torch.randn(2, 9, 16, 16)
    zero_maps = wide(torch.cat([image, torch.zeros_like(maps)], 1))
    torch.testing.assert_close(zero_maps, conv(image))
    assert not torch.allclose(wide(torch.cat([image, maps], 1)), conv(image))


def plain(conv: WidenedConv2d, images: torch.Tensor) -> torch.Tensor:
    return nn.functional.conv2d(images, conv.weight, conv.bias, conv.stride, conv.padding)


@pytest.mark.parametrize("bias", [True, False])
def test_maps_that_stay_are_remembered_and_nothing_else(bias: bool) -> None:
    """Against the plain convolution at every turn: other images, other maps and back, other weights, other batches."""
    torch.manual_seed(0)
    conv = WidenedConv2d(nn.Conv2d(3, 8, 7, 2, 3, bias=bias), 9).eval()
    maps, others = torch.randn(2, 9, 20, 24), torch.randn(2, 9, 20, 24)
    turns = [maps] * 4 + [others] * 3 + [maps] * 3 + [maps[:1]] * 3
    with torch.no_grad():
        for turn, seen in enumerate(turns):
            images = torch.cat([torch.randn(len(seen), 3, 20, 24), seen], 1)
            found, before = conv(images), conv._memory
            torch.testing.assert_close(found, plain(conv, images), rtol=1e-5, atol=1e-5)
            assert torch.equal(conv(images), found) and conv._memory is before  # remembered, and the same to the last bit
            if turn == 2:
                conv.weight.mul_(1.5)
            if turn == 11:
                conv.load_state_dict({name: w + 0.01 for name, w in conv.state_dict().items()})
    assert "_memory" not in str(list(conv.state_dict())) and len(conv.state_dict()) == 1 + bias


def test_nothing_is_remembered_where_gradients_are_wanted() -> None:
    conv = WidenedConv2d(nn.Conv2d(3, 8, 3, 1, 1), 9).eval()
    images = torch.randn(1, 12, 8, 8)
    with torch.no_grad():
        for _ in range(3):
            conv(images)
    conv(images).sum().backward()
    found = conv.weight.grad
    expected = torch.autograd.grad(plain(conv, images).sum(), conv.weight)[0]
    torch.testing.assert_close(found, expected)
    assert conv._memory is None
    conv.train()
    with torch.no_grad():
        for _ in range(3):
            conv(images)
    assert conv._memory is None


def test_weights_that_hide_their_changes_are_read_anew() -> None:
    with torch.inference_mode():
        conv = WidenedConv2d(nn.Conv2d(3, 8, 3, 1, 1), 9).eval()
        images = torch.randn(1, 12, 8, 8)
        for _ in range(3):
            torch.testing.assert_close(conv(images), plain(conv, images))
            conv.weight.mul_(1.5)


def test_what_is_remembered_follows_the_precision() -> None:
    conv = WidenedConv2d(nn.Conv2d(3, 8, 3, 1, 1), 9).eval()
    images = torch.randn(1, 12, 8, 8)
    with torch.no_grad():
        exact = [conv(images) for _ in range(3)][-1]
        with torch.autocast("cpu", dtype=torch.bfloat16):
            coarse = conv(images)
        again = conv(images)
    assert coarse.dtype == torch.bfloat16 and again.dtype == torch.float32
    torch.testing.assert_close(coarse.float(), exact, rtol=0.05, atol=0.05)
    torch.testing.assert_close(again, exact)


def test_trunk_gives_the_strides_it_is_asked_for() -> None:
    trunk = ImageBackbone("resnet18", (8, 16, 32), extra_channels=4).eval()
    with torch.no_grad():
        features = trunk(torch.zeros(2, 7, 64, 96))
    assert [tuple(f.shape) for f in features] == [(2, 128, 8, 12), (2, 256, 4, 6), (2, 512, 2, 3)]
    assert trunk.channels == [128, 256, 512]


@pytest.mark.parametrize("strides", [(16, 8), (12,), (64,)])
def test_strides_that_no_resnet_has_are_refused(strides: tuple[int, ...]) -> None:
    with pytest.raises(ValueError, match="backbone strides"):
        ImageBackbone("resnet18", strides)


def test_sizes_that_do_not_divide_are_refused() -> None:
    with pytest.raises(ValueError, match="100 x 64 is not a multiple of 16"):
        replace(CONFIG, image_width_px=100)
    with pytest.raises(ValueError, match="multiple of 8"):
        replace(CONFIG, grid=replace(CONFIG.grid, half_extent_m=16.0))


def test_frames_before_are_chained_with_their_motion() -> None:
    """Five metres ahead in the world, then a quarter turn to the left: where the earlier frames were, seen from now."""
    rig = ring_rig(2)
    poses = [Pose.identity(), Pose.from_euler(0, 0, 0, (5, 0, 0)), Pose.from_euler(np.pi / 2, 0, 0, (5, 0, 0))]
    frames = [replace(frame(i, rig), world_from_ego=pose) for i, pose in enumerate(poses)]
    drawn = frame_sample(frames[2], 96, 64, [frames[1], frames[0]])
    chain = collate([drawn, drawn])
    before = chain.previous
    assert before is not None and before.previous is not None and before.previous.previous is None
    assert before.key_from_ego is not None and before.key_from_ego.shape == (4, 4, 4)
    # the origin of the first frame lay 5 m behind the second's: to the left of the third's
    origins = [b.key_from_ego[0, :3, 3].tolist() for b in (before, before.previous) if b.key_from_ego is not None]
    np.testing.assert_allclose(origins, [[0, 0, 0], [0, 5, 0]], atol=1e-6)
    # from now to the frame before: only turned; from there to the first: only moved
    quarter = Pose.from_euler(np.pi / 2, 0, 0, (0, 0, 0)).matrix
    np.testing.assert_allclose(chain.previous_from_ego[1], quarter, atol=1e-6)
    np.testing.assert_allclose(before.previous_from_ego[1], Pose.from_euler(0, 0, 0, (5, 0, 0)).matrix, atol=1e-6)
    assert torch.equal(before.images[:2], collate([frame_sample(frames[1], 96, 64)]).images)
    assert collate([drawn, frame_sample(frames[0], 96, 64)]).previous is None
    with pytest.raises(ValueError, match="motion since the frames before is not known"):
        _ = before.previous.previous_from_ego
