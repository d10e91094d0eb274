"""Every key of the released files is loaded or left out for a reason; what moves, moves; what does not fit is named."""

from __future__ import annotations

import re
from functools import cache

import pytest
import torch
from parity_files import released_shapes
from torch import Tensor

from coin3d.training.released.box_rows import SizeOrder, our_box_rows
from coin3d.training.released.sources import SOURCES, Source, recognised, source_named

KEY_LISTS = {
    "coin3d-nuscenes": "coin3d_bevdet_keys.txt",
    "coin3d-mix": "coin3d_bevdet_keys.txt",
    "bevformer-tiny": "bevformer_keys.txt",
    "petr-vov": "petr_keys.txt",
    "petr-vov-mmdet3d": "petr_keys.txt",
}
HEAT = "pts_bbox_head.task_heads.0.heatmap.1."
_own_state = Source.own_state


@cache
def own_state(name: str) -> dict[str, Tensor]:
    return _own_state(source_named(name))


@pytest.fixture(autouse=True)
def built_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Source, "own_state", lambda source: own_state(source.name))


def file_of(source: str) -> dict[str, Tensor]:
    """Weights with the names and shapes of the released file: ones, which take no memory."""
    shapes = released_shapes(KEY_LISTS[source])
    if source == "coin3d-mix":
        shapes |= {f"{HEAT}weight": (3, 64, 3, 3), f"{HEAT}bias": (3,)}
    counters = "num_batches_tracked"
    return {n: torch.ones((), dtype=torch.long if counters in n else None).expand(shape) for n, shape in shapes.items()}


@pytest.mark.parametrize(
    ("name", "keys", "unused"),
    [
        ("coin3d-nuscenes", 601, 0),
        ("coin3d-mix", 601, 0),
        ("bevformer-tiny", 643, 1),
        ("petr-vov", 854, 5 * 16 + 1),
        ("petr-vov-mmdet3d", 854, 5 * 16 + 1),
    ],
)
def test_every_key_has_one_place_or_a_reason(name: str, keys: int, unused: int) -> None:
    source, released = source_named(name), file_of(name)
    own, converted = source.own_state(), source.convert(released)
    assert {n: (t.shape, t.dtype) for n, t in converted.items()} == {n: (t.shape, t.dtype) for n, t in own.items()}
    reasons = source.keys.unused(released)
    assert len(released) == keys and len(reasons) == unused and len(own) == keys - unused
    assert set(reasons) < set(released) and all(reasons.values())


@pytest.mark.parametrize(
    ("name", "key", "shape"),
    [
        ("coin3d-nuscenes", "img_neck.fpn_convs.0.conv.bias", (256,)),
        ("bevformer-tiny", "pts_bbox_head.bev_embedding.weight", (40000, 256)),
        ("petr-vov", "img_backbone.stem.stem_1/conv.weight", (64, 4, 3, 3)),
    ],
)
def test_a_key_that_is_missing_extra_or_misshapen_is_named(name: str, key: str, shape: tuple[int, ...]) -> None:
    source, released = source_named(name), file_of(name)
    with pytest.raises(ValueError, match=rf"lacks the weight for '{re.escape(str(source.keys.name(key)))}' \(1 are missing"):
        source.convert({n: t for n, t in released.items() if n != key})
    with pytest.raises(ValueError, match=rf"'{re.escape(key)}' of .* has shape {re.escape(str(shape))}, this detector needs"):
        source.convert({**released, key: torch.ones(shape)})
    for extra in ("pts_bbox_head.anchors", "teacher.conv1.weight", "img_neck.fpn_convs.1.conv.bias"):
        with pytest.raises(ValueError, match=rf"'{extra}' is no weight of the released"):
            source.convert({**released, extra: torch.ones(1)})
    past_the_end = {
        "bevformer-tiny": "pts_bbox_head.cls_branches.6.0.weight",
        "petr-vov": "pts_bbox_head.cls_branches.6.0.bias",
    }
    if name in past_the_end:
        with pytest.raises(ValueError, match=re.escape(past_the_end[name])):
            source.convert({**released, past_the_end[name]: torch.ones(256)})


def test_copies_of_a_shared_branch_must_agree() -> None:
    copy = "pts_bbox_head.cls_branches.3.6.bias"
    with pytest.raises(
        ValueError, match=r"'pts_bbox_head\.cls_branches\.3\.6\.bias' differs from '.*cls_branches\.0\.6\.bias'"
    ):
        source_named("petr-vov").convert({**file_of("petr-vov"), copy: torch.zeros(10)})


@pytest.mark.parametrize("name", ["petr-vov", "petr-vov-mmdet3d", "bevformer-tiny"])
def test_box_rows_of_every_branch_move(name: str) -> None:
    """Length before width, and the yaw turns the other way from another axis."""
    released = file_of(name)
    last = [n for n in released if re.search(r"reg_branches\.\d\.4\.", n)]
    for key in last:
        released[key] = torch.arange(1.0, 11).reshape(-1, *(1,) * (released[key].ndim - 1)).expand(released[key].shape)
    converted = source_named(name).convert(released)
    sizes = [3, 4] if name == "petr-vov-mmdet3d" else [4, 3]
    moved = [n for n in converted if re.search(r"box_branch(es\.\d)?\.4\.", n)]
    assert len(moved) == (12 if name == "bevformer-tiny" else 2) and len(last) == 12
    for key in moved:
        assert converted[key].reshape(10, -1)[:, 0].tolist() == [1, 2, *sizes, 5, 6, -8, -7, 9, 10]


def test_both_files_of_one_petr_become_the_same() -> None:
    authors, port = file_of("petr-vov"), file_of("petr-vov-mmdet3d")
    for key in (n for n in authors if re.search(r"reg_branches\.\d\.4\.", n)):
        authors[key] = torch.arange(float(authors[key].numel())).reshape(authors[key].shape)
        port[key] = authors[key][[0, 1, 3, 2, 4, 5, 6, 7, 8, 9]]
    ours, too = source_named("petr-vov").convert(authors), source_named("petr-vov-mmdet3d").convert(port)
    assert set(ours) == set(too) and all(torch.equal(ours[name], too[name]) for name in ours)


def test_channels_of_petr_that_move() -> None:
    """Blue comes last, sines and cosines alternate."""
    released = file_of("petr-vov")
    released["img_backbone.stem.stem_1/conv.weight"] = torch.arange(3.0)[None, :, None, None].expand(64, 3, 3, 3)
    released["pts_bbox_head.adapt_pos3d.0.weight"] = torch.arange(384.0)[None, :, None, None].expand(1024, 384, 1, 1)
    converted = source_named("petr-vov").convert(released)
    assert converted["backbone.stem.0.0.weight"][0, :, 0, 0].tolist() == [2, 1, 0]
    sine = converted["camera_sine.mlp.0.weight"][5, :, 0, 0].tolist()
    assert sine[:4] == [0, 64, 1, 65] and sine[126:130] == [63, 127, 128, 192]


@pytest.mark.parametrize("sizes", ["width-length", "length-width"])
def test_both_codings_of_one_box_become_the_same(sizes: SizeOrder) -> None:
    """A box 4 m long and 2 m wide with heading 0.3, as each of the released codings writes it."""
    width, length, yaw = *torch.tensor([2.0, 4.0]).log(), torch.tensor(-0.3 - torch.pi / 2)
    first, second = (width, length) if sizes == "width-length" else (length, width)
    rows = torch.tensor([1, 2, first, second, 3, 4, yaw.sin(), yaw.cos(), 5, 6])
    heading = torch.tensor(0.3)
    expected = torch.tensor([1, 2, length, width, 3, 4, heading.sin(), heading.cos(), 5, 6])
    torch.testing.assert_close(our_box_rows(rows, sizes), expected)


@pytest.mark.parametrize("source", [source_named("coin3d-mix"), source_named("bevformer-tiny")], ids=lambda s: s.name)
def test_files_that_are_unlike_all_others_are_recognised(source: Source) -> None:
    assert recognised(file_of(source.name)) is source


def test_files_that_are_alike_have_to_be_told_apart() -> None:
    with pytest.raises(ValueError, match=r"of 3, say with --from .* coin3d-nuscenes: .* coin3d-lyft: .* coin3d-waymo: "):
        recognised(file_of("coin3d-nuscenes"))
    with pytest.raises(ValueError, match=r"of 2, say with --from .* petr-vov: .* petr-vov-mmdet3d: "):
        recognised(file_of("petr-vov"))
    with pytest.raises(ValueError, match="though not the shapes, of these weights"):
        recognised({**file_of("bevformer-tiny"), "pts_bbox_head.bev_embedding.weight": torch.ones(9, 256)})
    with pytest.raises(ValueError, match=r"named like 'roi_head\.weight' are of no network that can be converted; there are"):
        recognised({"roi_head.weight": torch.ones(1)})


def test_what_the_sources_say_of_themselves() -> None:
    assert len({source.name for source in SOURCES}) == len(SOURCES)
    heights = {source.name: source.config.image_height_px for source in SOURCES}
    assert (heights["coin3d-nuscenes"], heights["coin3d-lyft"]) == (384, 384)
    assert (heights["coin3d-waymo"], heights["coin3d-mix"]) == (320, 320)
    moments = {s.name: s.options.released.moment for s in SOURCES if s.method == "coin3d"}
    assert moments.pop("coin3d-mix") == "cam_in_ego" and set(moments.values()) == {"ego_in_cam"}
    with pytest.raises(ValueError, match="no released weights are called 'yolo'; there are coin3d-nuscenes, "):
        source_named("yolo")
