"""The nine channels of the prior maps and the switches that choose among them."""

from __future__ import annotations

from dataclasses import dataclass

PRIOR_CHANNELS = 9
INVERSE_FOCAL = 0
GROUND_DEPTH = 1
GROUND_GRADIENT = 2
DIRECTION = slice(3, 6)
MOMENT = slice(6, 9)
PLUECKER = slice(3, 9)

CHANNEL_NAMES = ("inverse focal", "ground depth", "ground gradient", "dir x", "dir y", "dir z", "mom x", "mom y", "mom z")
"""For pictures and reports, in channel order."""


@dataclass(frozen=True)
class PriorSet:
    """Which of the four priors of the paper are used; one that is off neither modulates, projects nor concatenates.

    Args:
        inverse_focal: IF, paper eq. M_invF.
        ground_depth: GD, paper eq. ground_depth.
        ground_gradient: GG, paper eq. M_GG.
        pluecker: PR, paper eq. M_PR.
    """

    inverse_focal: bool = True
    ground_depth: bool = True
    ground_gradient: bool = True
    pluecker: bool = True

    @property
    def embedded(self) -> tuple[int, ...]:
        """Channels the projector embeds (paper eq. M_MixPriorProj): all in use but the inverse focal map."""
        channels: list[int] = []
        if self.ground_depth:
            channels.append(GROUND_DEPTH)
        if self.ground_gradient:
            channels.append(GROUND_GRADIENT)
        if self.pluecker:
            channels.extend(range(PRIOR_CHANNELS)[PLUECKER])
        return tuple(channels)

    @property
    def channels(self) -> tuple[int, ...]:
        """All channels in use, in channel order; these are concatenated to image and features."""
        return (INVERSE_FOCAL, *self.embedded) if self.inverse_focal else self.embedded
