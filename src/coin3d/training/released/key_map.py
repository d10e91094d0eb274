"""Names of released weights to ours: every one is mapped or left out with a reason."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass

import torch
from torch import Tensor

Replacement = str | Callable[[re.Match[str]], str]


@dataclass(frozen=True)
class KeyMap:
    """Rules from released names to ours; the first whose pattern matches a whole name counts.

    Several released weights may have the same name here: copies of one that is shared, which must then be equal.

    Args:
        source: whose names these are, for messages.
        rules: (pattern, replacement) as of ``re.sub``.
        left_out: (pattern, reason) of weights this project has no use for.
    """

    source: str
    rules: tuple[tuple[str, Replacement], ...]
    left_out: tuple[tuple[str, str], ...] = ()

    def name(self, released: str) -> str | None:
        """Our name of a weight, None if it is left out.

        Raises:
            ValueError: no rule for it.
        """
        if self.reason(released) is not None:
            return None
        for pattern, replacement in self.rules:
            if match := re.fullmatch(pattern, released):
                return match.expand(replacement) if isinstance(replacement, str) else replacement(match)
        raise ValueError(f"'{released}' is no weight of {self.source}; is the file of another detector?")

    def reason(self, released: str) -> str | None:
        """Why a weight is left out, None if it is not."""
        return next((reason for pattern, reason in self.left_out if re.fullmatch(pattern, released)), None)

    def unused(self, released: Iterable[str]) -> dict[str, str]:
        """Names whose numbers ``convert`` does not take, and why: left out, or a copy of one that it has taken."""
        taken: set[str] = set()
        reasons: dict[str, str] = {}
        for key in released:
            name = self.name(key)
            if name is None:
                reasons[key] = str(self.reason(key))
            elif name in taken:
                reasons[key] = "a copy of a weight that several layers share"
            else:
                taken.add(name)
        return reasons

    def convert(self, released: Mapping[str, Tensor], own: Mapping[str, Tensor]) -> dict[str, Tensor]:
        """Our state from a released one, in the number formats of ours.

        Args:
            released: its weights by name.
            own: the state of the detector that is to take them, for names, shapes and formats.

        Raises:
            ValueError: a weight that is unknown, missing or of another shape, or copies that differ, by name.
        """
        taken: dict[str, str] = {}
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
            first = taken.setdefault(name, key)
            if first != key and not torch.equal(tensor, released[first]):
                raise ValueError(f"'{key}' differs from '{first}', but {self.source} shares one weight between them")
        # counters of batch norm steer nothing here, and older files lack them
        missing = sorted(name for name in set(own) - set(taken) if not name.endswith("num_batches_tracked"))
        if missing:
            raise ValueError(f"the file lacks the weight for '{missing[0]}' ({len(missing)} are missing) of {self.source}")
        found = {name: released[key].to(own[name].dtype) for name, key in taken.items()}
        zero = {name: torch.zeros(own[name].shape, dtype=own[name].dtype) for name in set(own) - set(found)}
        return {**found, **zero}
