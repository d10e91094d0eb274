"""What the released BEVFormer weights expect beyond ours, for converted weights and parity tests only (spec detectors 2).

Models trained by this project use none of it. The differences, all of them in this file: the network works in nuScenes'
LiDAR frame (x right, y forward, on the roof), with pixels counted from 0; each of nuScenes' six cameras has an
embedding; numbers of the vehicle's bus enter the queries; the previous bird's-eye view is turned to the nearest cell
about a point outside of it and shifted by the translation in the sampling points; all encoder layers see the present as
it was before the first.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import torch
from jaxtyping import Float
from torch import Tensor, nn
from torch.nn import functional as F  # noqa: N812

from coin3d.detectors.bev_history import BevHistory
from coin3d.detectors.camera_seats import NUSCENES_HEADINGS_DEG, camera_seats
from coin3d.detectors.lift_splat import BevGrid
from coin3d.detectors.pillar_projection import cell_centres
from coin3d.detectors.released_lidar import ReleasedLidar


@dataclass(frozen=True)
class ReleasedBevFormer:
    """Constants of the released weights.

    Args:
        camera_headings_deg: where the cameras look that have embeddings, in their order (see ``camera_seats``).
        levels: level embeddings, of which the one-level network uses the first.
        bus_numbers: translation since the last frame (3), orientation quaternion (4), accelerations, rates and speeds (9),
            heading in radians, turn since the last frame in degrees.
        turn_centre_cells: column and row about which the previous bird's-eye view is turned (outside the grid of 50).
        first_pixel: coordinate of the centre of the first pixel of the network's input: pixels of the raw image were counted
            from 0, and halving the image halved them without the half pixel.
        lidar: the frame the network works in.
    """

    camera_headings_deg: tuple[float, ...] = NUSCENES_HEADINGS_DEG
    levels: int = 4
    bus_numbers: int = 18
    turn_centre_cells: tuple[float, float] = (100.0, 100.0)
    first_pixel: float = 0.25
    lidar: ReleasedLidar = field(default_factory=ReleasedLidar)


class ReleasedParts(nn.Module):
    """The weights ours do not have.

    Args:
        conventions: constants.
        grid: bird's-eye-view grid.
        channels: width of the network.
    """

    def __init__(self, conventions: ReleasedBevFormer, grid: BevGrid, channels: int) -> None:
        super().__init__()
        self.conventions, self.grid = conventions, grid
        self.camera_embedding = nn.Parameter(torch.randn(len(conventions.camera_headings_deg), channels))
        self.level_embedding = nn.Parameter(torch.randn(conventions.levels, channels))
        self.bus_mlp = nn.Sequential(
            nn.Linear(conventions.bus_numbers, channels // 2),
            nn.ReLU(inplace=True),
            nn.Linear(channels // 2, channels),
            nn.ReLU(inplace=True),
            nn.LayerNorm(channels),
        )

    def features(self, features: Float[Tensor, "m c h w"], ego_from_cam: Float[Tensor, "m 4 4"]) -> Float[Tensor, "m c h w"]:
        """Image features with the embeddings of camera and level; a camera's is that of the one that looked the same way."""
        seats = camera_seats(ego_from_cam, self.conventions.camera_headings_deg)
        embedding = self.camera_embedding[seats] + self.level_embedding[0]
        return features + embedding[:, :, None, None]

    def queries(
        self,
        queries: Float[Tensor, "q c"],
        previous_bev: Float[Tensor, "b q c"] | None,
        previous_from_current: Float[Tensor, "b 4 4"] | None,
        bus: Float[Tensor, "b n"] | None,
        samples: int,
    ) -> tuple[Float[Tensor, "b q c"], BevHistory | None]:
        """What the cells of each sample start from, and their history.

        Args:
            queries: learned start.
            previous_bev: of the frames before, if any.
            previous_from_current: ego motion since; used where ``bus`` is not given.
            bus: the vehicle's own numbers.
            samples: B.

        Raises:
            ValueError: history without motion.
        """
        if bus is None:
            if previous_from_current is None:
                if previous_bev is not None:
                    raise ValueError("previous_bev needs previous_from_current: how the ego vehicle moved since")
                previous_from_current = torch.eye(4, device=queries.device).expand(samples, 4, 4)
            bus = self.bus_from_motion(previous_from_current)
        started = queries + self.bus_mlp(bus)[:, None]
        return started, None if previous_bev is None else self.history(previous_bev, bus)

    def bus_from_motion(self, previous_from_current: Float[Tensor, "b 4 4"]) -> Float[Tensor, "b n"]:
        """The numbers of the bus that ego poses tell; absolute heading and what only the bus knows are zero.

        Only heading relative to translation matters to the geometry, so the present ego axes stand in for the world's.
        """
        bus = torch.zeros(len(previous_from_current), self.conventions.bus_numbers, device=previous_from_current.device)
        rotation = previous_from_current[:, :3, :3]
        bus[:, :3] = torch.einsum("bji,bj->bi", rotation, previous_from_current[:, :3, 3])
        bus[:, 3] = 1.0
        bus[:, -1] = torch.rad2deg(torch.atan2(rotation[:, 1, 0], rotation[:, 0, 0]))
        return bus

    def history(self, previous_bev: Float[Tensor, "b q c"], bus: Float[Tensor, "b n"]) -> BevHistory:
        """The previous bird's-eye view, turned; its translation goes into the references."""
        numbers = bus.double()
        distance_m = torch.hypot(numbers[:, 0], numbers[:, 1])
        bearing = numbers[:, -2] - torch.atan2(numbers[:, 1], numbers[:, 0])
        moved_m = torch.stack([distance_m * bearing.sin(), distance_m * bearing.cos()], dim=-1)
        centres = cell_centres(self.grid, previous_bev.device)
        shift = (moved_m / (2 * self.grid.half_extent_m)).to(centres.dtype)
        return BevHistory(self._turned(previous_bev, numbers[:, -1]), centres + shift[:, None], refresh=False)

    def _turned(self, bev: Float[Tensor, "b q c"], angle_deg: Float[Tensor, "b"]) -> Float[Tensor, "b q c"]:
        side = self.grid.side
        cell = torch.arange(side, device=bev.device, dtype=torch.float32) + 0.5
        row, column = torch.meshgrid(cell, cell, indexing="ij")
        centre_x, centre_y = self.conventions.turn_centre_cells
        turn = torch.deg2rad(angle_deg).float()[:, None, None]
        dx, dy = column - centre_x, row - centre_y
        source_x = turn.cos() * dx - turn.sin() * dy + centre_x
        source_y = turn.sin() * dx + turn.cos() * dy + centre_y
        where = torch.stack([source_x, source_y], dim=-1) * (2 / side) - 1
        maps = bev.transpose(1, 2).reshape(len(bev), -1, side, side)
        turned = F.grid_sample(maps, where.to(maps.dtype), mode="nearest", padding_mode="zeros", align_corners=False)
        return turned.flatten(2).transpose(1, 2)
