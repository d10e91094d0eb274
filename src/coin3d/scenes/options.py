"""How scenes are built."""

from __future__ import annotations

from dataclasses import dataclass, field

from coin3d.scenes.assemble import SplatRadii
from coin3d.scenes.completion import DepthCompletion, EdgeAwareCompletion
from coin3d.scenes.inpainting import FastMarchingInpainting, Inpainting
from coin3d.scenes.views import PAPER_WIDTH_PX


@dataclass(frozen=True)
class BuildOptions:
    """Options of a build. The same recording and options give the same bytes.

    Args:
        width_px: images are shrunk to this width before anything is built from them; narrower ones stay as they are.
        voxel_m: of the background's fusion.
        radii: sizes of the Gaussians.
        completion: fills the holes of mesh depth; it is sent to worker processes, so it must be picklable.
        inpainting: colours behind objects.
        neighbours: frames before and after a frame that lend it colours.
        band: width of the band behind near edges, as a share of the image width.
        sharpen: rounds of correcting colours for the blur of splatting; 0 as in the paper.
        object_range_m: objects farther from the ego get no unseen sides.
        keep_depth: keep the depth of every image in the scene's folder.
        min_psnr_db: scenes whose images come out worse on average are listed as raw-only.
        min_known: scenes with a smaller share of pixels below the horizon with measured depth are listed as raw-only.
    """

    width_px: int = PAPER_WIDTH_PX
    voxel_m: float = 0.1
    radii: SplatRadii = field(default_factory=SplatRadii)
    completion: DepthCompletion = field(default_factory=EdgeAwareCompletion)
    inpainting: Inpainting = field(default_factory=FastMarchingInpainting)
    neighbours: int = 4
    band: float = 0.04
    sharpen: int = 2
    object_range_m: float = 60.0
    keep_depth: bool = False
    min_psnr_db: float = 20.0
    min_known: float = 0.3

    def __post_init__(self) -> None:
        if self.width_px < 16 or self.voxel_m <= 0:
            raise ValueError(f"scenes need width_px of 16 or more and voxel_m above 0, got {self.width_px}, {self.voxel_m}")
        for name in ("neighbours", "band", "sharpen", "object_range_m"):
            if getattr(self, name) < 0:
                raise ValueError(f"{name} of a build is 0 or more, got {getattr(self, name)}")

    @property
    def blind_spacing_m(self) -> float:
        """Grid of the ground under the vehicle: 0.02 m at 800 pixels (paper), coarser in proportion for narrower images."""
        return self.radii.blind_m * max(1.0, PAPER_WIDTH_PX / self.width_px)
