"""PETR-VoV with generated weights in the released names: converted, loaded, and compared stage by stage.

The fixture's own frame (x right, y forward) stands for the ego here, so that nothing but the network is compared.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest
import torch
from parity_files import filler, fixture, released_weights
from torch import Tensor

from coin3d.detectors.batch import Batch
from coin3d.detectors.petr import PETR
from coin3d.detectors.petr_config import PETRConfig
from coin3d.detectors.query_boxes import decode_queries
from coin3d.detectors.query_conventions import ReleasedQueryConventions
from coin3d.detectors.query_losses import QueryLossWeights, QueryTargets, query_losses, query_targets
from coin3d.detectors.released_lidar import ReleasedLidar
from coin3d.geometry import Boxes3D, wrap_angle
from coin3d.geometry.camera_tensors import CameraTensors
from coin3d.methods import Method
from coin3d.training.released.box_rows import our_box_rows
from coin3d.training.released.petr_keys import PETR_KEYS, petr_in_our_conventions

HEIGHT_PX, WIDTH_PX = 64, 160
CLASSES = tuple(f"class{i}" for i in range(10))
CONVENTIONS = ReleasedQueryConventions(
    lidar=ReleasedLidar((0.0, 0.0, 0.0), 0.0),
    point_in_cell_px=0.0,
    camera_headings_deg=(90.0, 35.0, 145.0, -90.0, -35.0, -145.0),
)


@dataclass(frozen=True)
class Run:
    """Outputs of the converted detector on the fixture's input."""

    stored: dict[str, np.ndarray]
    model: PETR
    batch: Batch
    c4: Tensor
    p4: Tensor
    p5: Tensor
    outputs: dict[str, Tensor]


@pytest.fixture(scope="module")
def run() -> Run:
    stored, generated = fixture("petr_vov_64x160.npz"), filler()
    config = replace(PETRConfig.released_nuscenes(), image_width_px=WIDTH_PX, image_height_px=HEIGHT_PX, released=CONVENTIONS)
    with torch.device("meta"):
        model = PETR(config, CLASSES, Method())
    weights = PETR_KEYS.convert(released_weights("petr_keys.txt", generated.petr_canon), model.state_dict())
    model.load_state_dict(petr_in_our_conventions(weights, "width-length"), assign=True)
    model.eval()
    images = generated.randn("petr_img", 6, 3, HEIGHT_PX, WIDTH_PX).flip(1)  # BGR, as the released detector reads them
    batch = Batch(images, fixture_cameras(stored["lidar2img"]), torch.zeros(6, dtype=torch.long), torch.eye(3)[None])
    passed: dict[str, Tensor] = {}
    for name, part in {"c": model.backbone, "p4": model.neck, "p5": model.neck.lateral_convs[1]}.items():
        part.register_forward_hook(lambda _, __, out, name=name: passed.update({name: out}))
    with torch.inference_mode():
        outputs = model(batch)
    return Run(stored, model, batch, passed["c"][0], passed["p4"], passed["p5"], outputs)


def fixture_cameras(lidar2img: np.ndarray) -> CameraTensors:
    """Projections taken apart into intrinsics and pose."""
    K, poses = [], []
    for projection in lidar2img:
        # rows of an RQ decomposition, which numpy has as QR of the reversed matrix
        q, r = np.linalg.qr(np.flipud(projection[:3, :3]).T)
        upper, rotation = np.fliplr(np.flipud(r.T)), np.flipud(q.T)
        sign = np.diag(np.sign(np.diag(upper)))
        upper, rotation = upper @ sign, sign @ rotation
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = rotation.T, -np.linalg.inv(projection[:3, :3]) @ projection[:3, 3]
        K.append(upper)
        poses.append(pose)
    ground = torch.tensor([0.0, 0.0, 1.0, 0.0]).expand(len(K), 4)
    return CameraTensors(torch.tensor(np.stack(K)).float(), torch.tensor(np.stack(poses)).float(), ground, HEIGHT_PX, WIDTH_PX)


def assert_near(ours: Tensor, theirs: np.ndarray, tolerance: float) -> None:
    expected = torch.from_numpy(theirs)
    assert ours.shape == expected.shape
    error = float((ours - expected).abs().max() / expected.abs().max())
    assert error < tolerance, error


def in_our_code(theirs: np.ndarray) -> np.ndarray:
    codes = torch.from_numpy(theirs).movedim(-1, 0)
    return our_box_rows(codes, "width-length").movedim(0, -1).numpy()


def test_image_trunk_and_neck(run: Run) -> None:
    assert_near(run.c4[:, ::16], run.stored["c4"], 2e-5)
    assert_near(run.p4[None], run.stored["p4"], 2e-5)
    assert_near(run.p5[None], run.stored["p5"], 2e-5)


def test_position_embedding(run: Run) -> None:
    with torch.inference_mode():
        ours = run.model.rays(run.batch.cameras, torch.eye(4).expand(6, 4, 4))
    assert_near(ours[None], run.stored["pos3d"], 1e-4)


def test_outputs_of_all_decoder_layers(run: Run) -> None:
    assert_near(run.outputs["class_logits"], run.stored["cls"], 1e-4)
    ours = run.outputs["boxes"]
    for channel, theirs in enumerate(np.moveaxis(in_our_code(run.stored["box"]), -1, 0)):
        assert_near(ours[..., channel], theirs, 1e-4)


def rows(boxes: Boxes3D) -> np.ndarray:
    """One row per box, in an order that does not depend on ties between scores."""
    yaw = np.column_stack([np.cos(boxes.yaw_rad), np.sin(boxes.yaw_rad)])
    table = np.column_stack([boxes.centre_m, boxes.size_m, yaw, boxes.velocity_mps, boxes.scores])
    return table[np.lexsort((np.round(table[:, 0], 2), np.round(table[:, 1], 2), boxes.labels))]


def released_boxes(values: np.ndarray, labels: np.ndarray, scores: np.ndarray | None, *, bottom: bool) -> Boxes3D:
    """The old convention: (width, length), yaw clockwise from -y, and a centre that may be the bottom's."""
    values = values.astype(np.float64)
    centre = values[:, :3] + np.outer(values[:, 5] / 2 if bottom else np.zeros(len(values)), [0, 0, 1])
    yaw = wrap_angle(-values[:, 6] - np.pi / 2)
    names = [CLASSES[i] for i in labels]
    return Boxes3D.create(centre, values[:, [4, 3, 5]], yaw, names, scores=scores, velocity_mps=values[:, 7:])


def stored_detections(run: Run) -> Boxes3D:
    stored = run.stored
    return released_boxes(stored["dec_boxes"], stored["dec_labels"], stored["dec_scores"], bottom=False)


def test_decoded_boxes_of_stored_outputs(run: Run) -> None:
    logits, codes = torch.from_numpy(run.stored["cls"][-1]), torch.from_numpy(in_our_code(run.stored["box"])[-1])
    (ours,) = decode_queries(logits, codes, CLASSES, run.model.config.decode)
    theirs = stored_detections(run)
    assert len(ours) == len(theirs) == 300
    np.testing.assert_allclose(rows(ours), rows(theirs), atol=1e-5)


def test_decoded_boxes_end_to_end(run: Run) -> None:
    """Scores to tolerance, and all but the last few boxes, which tie."""
    final = {name: outputs[-1] for name, outputs in run.outputs.items()}
    (ours,) = decode_queries(final["class_logits"], final["boxes"], CLASSES, run.model.config.decode)
    theirs = stored_detections(run)
    np.testing.assert_allclose(ours.scores, np.sort(theirs.scores)[::-1], atol=1e-4)
    gap = np.abs(ours.centre_m[:, None] - theirs.centre_m).max(-1) + (ours.labels[:, None] != theirs.labels)
    assert (gap.min(0) < 0.01).sum() >= 298


def targets(run: Run) -> list[QueryTargets]:
    truth = released_boxes(run.stored["gt"], run.stored["labels"], None, bottom=True)
    return [query_targets(truth, CLASSES, run.model.config.box_space)]


def assert_losses(ours: dict[str, Tensor], stored: dict[str, np.ndarray], tolerance: float) -> None:
    theirs = dict(zip(stored["loss_names"].tolist(), stored["loss_vals"].tolist(), strict=True))
    assert len(ours) == len(theirs) == 12
    for layer in range(1, 7):
        prefix = "" if layer == 6 else f"d{layer - 1}."
        assert float(ours[f"class_{layer}"]) == pytest.approx(theirs[f"{prefix}loss_cls"], rel=tolerance)
        assert float(ours[f"box_{layer}"]) == pytest.approx(theirs[f"{prefix}loss_bbox"], rel=tolerance)


def test_losses_of_stored_outputs(run: Run) -> None:
    logits, codes = torch.from_numpy(run.stored["cls"]), torch.from_numpy(in_our_code(run.stored["box"]))
    assert_losses(query_losses(logits, codes, targets(run), QueryLossWeights()), run.stored, 1e-5)


def test_losses_end_to_end(run: Run) -> None:
    ours = query_losses(run.outputs["class_logits"], run.outputs["boxes"], targets(run), run.model.config.weights)
    assert_losses(ours, run.stored, 1e-4)
