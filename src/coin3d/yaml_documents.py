"""YAML that anybody may have written: plain values only, in bounded time and memory, and one kind of error."""

from __future__ import annotations

from typing import Any

import yaml

LARGEST_BYTES = 2**20
"""No calibration is larger; PyYAML takes a second for it."""

_MOST_MERGED = 20_000


def read_yaml(text: str, where: str) -> list[Any]:
    """The documents of a text, which ``---`` separates; empty ones are None.

    Aliases are shared and not copied, so what comes out may be far larger when it is walked or printed than the text was.

    Args:
        text: at most ``LARGEST_BYTES``.
        where: names it in errors.

    Raises:
        ValueError: too long, or no YAML of plain values.
    """
    if len(text) > LARGEST_BYTES:
        raise ValueError(f"{where}: {len(text) / 2**20:.1f} MiB is too large for a calibration (limit 1 MiB)")
    try:
        return list(yaml.load_all(text, Loader=_Loader))
    except RecursionError as error:
        raise ValueError(f"{where}: not readable as YAML: nested too deeply") from error
    # values with a tag that does not fit them ('!!int x', '2001-99-99') trip PyYAML in all of these ways
    except (yaml.YAMLError, ValueError, TypeError, KeyError, IndexError, AttributeError, OverflowError) as error:
        raise ValueError(f"{where}: not readable as YAML: {error}") from error


class _Loader(yaml.SafeLoader):
    """Merge keys (<<) copy what they name: a few hundred bytes of them could ask for more than any memory."""

    _merged = 0

    def flatten_mapping(self, node: yaml.MappingNode) -> None:
        """Replace merge keys by the entries of the mappings they name; earlier ones win, the mapping's own always."""
        merged: list[tuple[yaml.Node, yaml.Node]] = []
        own = []
        for key, value in node.value:
            if key.tag != "tag:yaml.org,2002:merge":
                own.append((key, value))
                continue
            for part in reversed(value.value if isinstance(value, yaml.SequenceNode) else [value]):
                if not isinstance(part, yaml.MappingNode):
                    raise yaml.constructor.ConstructorError(None, None, "<< names something else than mappings", key.start_mark)
                self.flatten_mapping(part)
                self._merged += len(part.value)
                if self._merged > _MOST_MERGED:
                    raise yaml.constructor.ConstructorError(None, None, "<< merges too many entries", key.start_mark)
                merged += part.value
        node.value = merged + own
