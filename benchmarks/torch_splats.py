"""The renderer's definition in plain vectorised torch, 16x16 tiles and 64 splats at a time: what one writes without C++."""

from __future__ import annotations

import torch
from torch import Tensor

from coin3d.geometry import Camera
from coin3d.rendering import Gaussians
from coin3d.rendering.view import BLUR_PX2, MAX_ALPHA, MIN_ALPHA, MIN_TRANSMITTANCE, NEAR_M, slope_limits

TILE, STEP = 16, 64
CUTOFF = 11.08253
BATCH = 64  # tiles


def _project(centre: Tensor, std: Tensor, camera: Camera) -> tuple[Tensor, Tensor, Tensor, Tensor, Tensor]:
    """Pixel (n, 2), precision (n, 3: xx, xy, yy), depth, half box (n, 2) and rows of what is before the camera."""
    pose, limits = camera.ego_from_cam, slope_limits(camera)
    R = torch.tensor(pose.rotation, dtype=torch.float32)
    points = (centre - torch.tensor(pose.translation, dtype=torch.float32)) @ R
    rows = torch.nonzero(points[:, 2] > NEAR_M)[:, 0]
    x, y, z = points[rows].unbind(1)
    K = torch.tensor(camera.K, dtype=torch.float32)
    pixel = torch.stack([x / z, y / z], 1) @ K[:2, :2].T + K[:2, 2]
    slope = torch.stack([(x / z).clamp(limits.x_min, limits.x_max), (y / z).clamp(limits.y_min, limits.y_max)], 1)
    k = slope @ K[:2, :2].T
    G = K[:2, :2] @ K[:2, :2].T
    s2 = (std[rows] / z) ** 2
    xx, yy = s2 * (G[0, 0] + k[:, 0] ** 2) + BLUR_PX2, s2 * (G[1, 1] + k[:, 1] ** 2) + BLUR_PX2
    xy = s2 * (G[0, 1] + k[:, 0] * k[:, 1])
    det = xx * yy - xy**2
    half = (CUTOFF * torch.stack([xx, yy], 1)).sqrt()
    size = torch.tensor([camera.width_px, camera.height_px])
    seen = ((pixel + half > 0) & (pixel - half < size)).all(1)
    precision = torch.stack([yy, -xy, xx], 1) / det[:, None]
    return pixel[seen], precision[seen], z[seen], half[seen], rows[seen]


def _pairs(pixel: Tensor, half: Tensor, depth: Tensor, columns: int, rows: int) -> tuple[Tensor, Tensor]:
    """Splat of every (tile, splat) pair by tile and depth, and where each tile begins (tiles + 1)."""
    last = torch.tensor([columns - 1, rows - 1])
    low = torch.minimum(((pixel - half) / TILE).floor().long().clamp(min=0), last)
    high = torch.minimum(((pixel + half) / TILE).floor().long().clamp(min=0), last)
    span = high - low + 1
    count = span[:, 0] * span[:, 1]
    splat = torch.repeat_interleave(torch.arange(len(count)), count)
    within = torch.arange(len(splat)) - torch.repeat_interleave(count.cumsum(0) - count, count)
    x, y = low[splat, 0] + within % span[splat, 0], low[splat, 1] + within // span[splat, 0]
    tile = y * columns + x
    order = torch.argsort((tile << 32) + depth.view(torch.int32)[splat].long(), stable=True)
    begin = torch.searchsorted(tile[order], torch.arange(columns * rows + 1))
    return splat[order], begin


def render_torch(gaussians: Gaussians, camera: Camera) -> tuple[Tensor, Tensor, Tensor]:
    """Colours (h, w, 3) in [0, 1], depth (h, w) and alpha (h, w)."""
    with torch.no_grad():
        pixel, precision, depth, half, kept = _project(torch.tensor(gaussians.centre_m), torch.tensor(gaussians.std_m), camera)
        values = torch.cat([torch.tensor(gaussians.rgb)[kept] / 255, depth[:, None]], 1)
        columns, rows = -(-camera.width_px // TILE), -(-camera.height_px // TILE)
        splat, begin = _pairs(pixel, half, depth, columns, rows)
        out, transmittance = torch.zeros(columns * rows, TILE * TILE, 4), torch.ones(columns * rows, TILE * TILE)
        v, u = torch.meshgrid(torch.arange(TILE), torch.arange(TILE), indexing="ij")
        corner = torch.stack([torch.arange(columns * rows) % columns, torch.arange(columns * rows) // columns], 1) * TILE
        centres = corner[:, None] + torch.stack([u.flatten(), v.flatten()], 1) + 0.5
        for batch in torch.arange(columns * rows).split(BATCH):
            active, open_, position = batch, torch.ones(len(batch), TILE * TILE, dtype=torch.bool), begin[batch]
            while len(active):
                index = position[:, None] + torch.arange(STEP)
                valid = index < begin[active + 1][:, None]
                s = splat[index.clamp(max=len(splat) - 1)]
                d = centres[active][:, None] - pixel[s][:, :, None]
                p = precision[s][:, :, None]
                q = p[..., 0] * d[..., 0] ** 2 + 2 * p[..., 1] * d[..., 0] * d[..., 1] + p[..., 2] * d[..., 1] ** 2
                alpha = (-q / 2).exp().clamp(max=MAX_ALPHA)
                alpha = alpha * ((alpha >= MIN_ALPHA) & valid[:, :, None])
                after = transmittance[active][:, None] * (1 - alpha).cumprod(1)
                before = torch.cat([transmittance[active][:, None], after[:, :-1]], 1)
                drawn = (after >= MIN_TRANSMITTANCE) & open_[:, None]
                out[active] += torch.einsum("tsp,tsc->tpc", alpha * before * drawn, values[s])
                transmittance[active] = (
                    torch.where(drawn, after, before.new_tensor(2.0)).amin(1).clamp(max=transmittance[active])
                )
                open_ = open_ & drawn[:, -1]
                position = position + STEP
                go = (position < begin[active + 1]) & open_.any(1)
                active, open_, position = active[go], open_[go], position[go]
        both = torch.cat([out, 1 - transmittance[..., None]], 2).reshape(rows, columns, TILE, TILE, 5)
        image = both.permute(0, 2, 1, 3, 4).reshape(rows * TILE, columns * TILE, 5)[: camera.height_px, : camera.width_px]
        return image[..., :3], image[..., 3], image[..., 4]
