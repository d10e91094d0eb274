"""Names of released weights to ours: every one is mapped or left out with a reason."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass

import torch
from torch import Tensor


@dataclass(frozen=True)
class KeyMap:
    """Rules from released names to ours; the first whose pattern matches a whole name counts.

    Args:
        source: whose names these are, for messages.
        rules: (pattern, replacement) as of ``re``.
        left_out: (pattern, reason) of weights this project has no use for.
    """

    source: str
    rules: tuple[tuple[str, str], ...]
    left_out: tuple[tuple[str, str], ...] = ()

    def name(self, released: str) -> str | None:
        """Our name of a weight, None if it is left out.

        Raises:
            ValueError: no rule for it.
        """
        if self.reason(released) is not None:
            return None
        for pattern, replacement in self.rules:
            if re.fullmatch(pattern, released):
                return re.sub(pattern, replacement, released)
        raise ValueError(f"'{released}' is no weight of {self.source}; is the file of another detector?")

    def reason(self, released: str) -> str | None:
        """Why a weight is left out, None if it is not."""
        return next((reason for pattern, reason in self.left_out if re.fullmatch(pattern, released)), None)

    def convert(self, released: Mapping[str, Tensor], own: Mapping[str, Tensor]) -> dict[str, Tensor]:
        """Our state from a released one.

        Args:
            released: its weights by name.
            own: the state of the detector that is to take them, for names and shapes.

        Raises:
            ValueError: a weight that is unknown, missing or of another shape, by name.
        """
        found: dict[str, Tensor] = {}
        for key, tensor in released.items():
            name = self.name(key)
            if name is None:
                continue
            if name not in own:
                raise ValueError(f"'{key}' of {self.source} would be '{name}', which this detector does not have")
            if tensor.shape != own[name].shape:
                raise ValueError(
                    f"'{key}' of {self.source} has shape {tuple(tensor.shape)}, this detector needs {tuple(own[name].shape)}"
                )
            found[name] = tensor
        # counters of batch norm steer nothing here, and older files lack them
        missing = sorted(name for name in set(own) - set(found) if not name.endswith("num_batches_tracked"))
        if missing:
            raise ValueError(f"the file lacks the weight for '{missing[0]}' ({len(missing)} are missing) of {self.source}")
        zero = {name: torch.zeros_like(own[name]) for name in set(own) - set(found)}
        return {**found, **zero}
