"""The first convolution of a trunk, widened to read prior maps beside RGB. It remembers what it makes of the maps of a rig."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor, nn


@dataclass(frozen=True, eq=False)
class _Memory:
    """Maps, the weights they were seen with, and what the convolution makes of them."""

    maps: Tensor
    weights: tuple[int, int]
    response: Tensor

    def holds(self, maps: Tensor, weights: tuple[int, int], dtype: torch.dtype) -> bool:
        """Whether the response is that to ``maps``, in the precision that is asked for now."""
        known = self.weights == weights and self.response.dtype == dtype
        return known and self.maps.dtype == maps.dtype and self.maps.device == maps.device and torch.equal(self.maps, maps)


class WidenedConv2d(nn.Conv2d):
    """A convolution that reads extra channels: the old slice of weights is kept, the new one gets PyTorch's initialisation.

    The new slice is never spread from the RGB weights: those are edge filters, and the priors are smooth maps.

    A convolution is linear: its response to image and maps is the sum of both. Prior maps stay the same as long as the rig
    does, so without gradients both parts are computed for themselves, and that of the maps is remembered: nine maps would be
    three quarters of the work of a seven by seven convolution at the largest resolution there is. What comes out does not
    depend on whether it was remembered.

    Args:
        conv: as it reads RGB.
        extra_channels: further ones, behind those.
    """

    def __init__(self, conv: nn.Conv2d, extra_channels: int) -> None:
        super().__init__(
            conv.in_channels + extra_channels,
            conv.out_channels,
            conv.kernel_size,  # type: ignore[arg-type]
            conv.stride,  # type: ignore[arg-type]
            conv.padding,  # type: ignore[arg-type]
            bias=conv.bias is not None,
        )
        self.image_channels = conv.in_channels
        self._memory: _Memory | None = None
        with torch.no_grad():
            self.weight[:, : conv.in_channels] = conv.weight
            if conv.bias is not None and self.bias is not None:
                self.bias.copy_(conv.bias)

    def forward(self, images: Float[Tensor, "m c h w"]) -> Float[Tensor, "m k h2 w2"]:
        """What a plain convolution gives, up to the rounding of one sum."""
        # weights made under inference_mode do not tell when they change
        if self.training or torch.is_grad_enabled() or torch.compiler.is_compiling() or self.weight.is_inference():
            self._memory = None
            return super().forward(images)
        maps, weights = images[:, self.image_channels :], (self.weight.data_ptr(), self.weight._version)
        out: Tensor = self._conv_forward(images[:, : self.image_channels], self.weight[:, : self.image_channels], None)
        memory = self._memory
        if memory is None or not memory.holds(maps, weights, out.dtype):
            response = self._conv_forward(maps, self.weight[:, self.image_channels :], self.bias)
            self._memory = memory = _Memory(maps.clone(), weights, response)
        out += memory.response
        return out
