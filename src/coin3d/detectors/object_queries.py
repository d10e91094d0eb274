"""Object queries before the decoder: where they start, from what, and what is known of their objects."""

from __future__ import annotations

from dataclasses import dataclass, fields

import torch
from jaxtyping import Float
from torch import Tensor

from coin3d.detectors.query_boxes import CODE_SIZE

PRIOR_LOGIT = -4.595
"""Score of a query of which nothing is known: sigmoid = 0.01, the usual prior where almost every query stands for nothing."""


@dataclass(frozen=True, eq=False)
class ObjectQueries:
    """N queries of each sample.

    Args:
        place: (B, N, 3) where they start, 0..1 in the range of the boxes.
        position: (B, N, C) embedding of that.
        content: (B, N, C) what they start from.
        code: (B, N, 10) what the decoder's boxes are corrections to, beside the place (see query_boxes); zeros if nothing.
        logits: (B, N, K) what its scores are corrections to; zeros if nothing.
    """

    place: Float[Tensor, "b n 3"]
    position: Float[Tensor, "b n c"]
    content: Float[Tensor, "b n c"]
    code: Float[Tensor, "b n 10"]
    logits: Float[Tensor, "b n k"]

    @classmethod
    def learned(
        cls, place: Float[Tensor, "b n 3"], position: Float[Tensor, "b n c"], content: Float[Tensor, "b n c"], classes: int
    ) -> ObjectQueries:
        """Queries of which nothing is known."""
        shape = place.shape[:2]
        return cls(place, position, content, place.new_zeros(*shape, CODE_SIZE), place.new_zeros(*shape, classes))

    def joined(self, others: ObjectQueries | None) -> ObjectQueries:
        """These queries, then others of the same samples."""
        if others is None:
            return self
        return ObjectQueries(*(torch.cat([getattr(self, f.name), getattr(others, f.name)], dim=1) for f in fields(self)))
