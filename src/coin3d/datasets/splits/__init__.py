"""Splits: which scenes of a data set train and which validate. The names lie beside this file, one per line.

nuScenes publishes its splits. Lyft has none; the lists are those of mmdetection3d, which the field compares on. Waymo's
splits are folders (training, validation, testing), so there is nothing to list: open the folder.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Sequence
from functools import cache
from pathlib import Path

SplitChoice = str | Path | Collection[str]
"""The name of a split (``val``), a text file with scene names, or the names themselves."""

_FOLDER = Path(__file__).parent
_SHOWN = 3
_LARGEST_LIST = 2**24
_LONGEST_NAME = 200


@cache
def known_splits() -> dict[str, dict[str, frozenset[str]]]:
    """Data set -> name of the split -> its scenes."""
    found: dict[str, dict[str, frozenset[str]]] = {}
    for path in sorted(_FOLDER.glob("*.txt")):
        data_set, _, name = path.stem.partition("-")
        found.setdefault(data_set, {})[name] = frozenset(read_names(path))
    return found


def data_set_of(scenes: Collection[str]) -> str | None:
    """The data set that these scenes belong to by their names, if it has splits here."""
    for data_set, splits in known_splits().items():
        if any(names & set(scenes) for names in splits.values()):
            return data_set
    return None


def chosen_scenes(split: SplitChoice | None, available: Sequence[str], where: str) -> list[str]:
    """The scenes of a recording that a split chooses, in the order of the recording.

    Of a split by name, scenes that the recording lacks are no error: parts of a data set are common. Whoever reports numbers
    says how many there were (``coverage``). Names that were listed on purpose must all be there.

    Args:
        split: what to choose; None chooses everything.
        available: the scenes of the recording.
        where: names the recording in errors.

    Raises:
        FileNotFoundError: no such text file.
        ValueError: no such split, none of its scenes in the recording, or a listed scene that is missing.
    """
    if split is None:
        return list(available)
    if isinstance(split, str) and not split.endswith(".txt"):
        wanted = _named(split, available, where)
    else:
        wanted = frozenset(read_names(Path(split))) if isinstance(split, str | Path) else frozenset(split)
        if missing := sorted(wanted - set(available)):
            raise ValueError(f"{where}: has no {_some('scene', missing)}; its own are {_some('', list(available))}")
    chosen = [name for name in available if name in wanted]
    if not chosen:
        raise ValueError(f"{where}: none of its {len(available)} scenes ({_some('', list(available))}) is in the split {split}")
    return chosen


def coverage(split: SplitChoice | None, scenes: Collection[str]) -> str:
    """One phrase for results: which part of a split these scenes are."""
    count = len(set(scenes))
    here = f"{count} scene{'s' * (count != 1)}"
    if split is None:
        return here
    data_set = data_set_of(scenes)
    if isinstance(split, str) and data_set is not None and split in known_splits()[data_set]:
        return f"{count} of the {len(known_splits()[data_set][split])} scenes of {data_set} {split}"
    return f"{here} of {split if isinstance(split, str | Path) else 'a list'}"


def read_names(path: Path) -> list[str]:
    """The names in a text file: one per line; lines that start with # and empty ones do not count.

    Raises:
        FileNotFoundError: no such file.
        ValueError: not text, no names, or a name twice.
    """
    if not path.is_file():
        raise FileNotFoundError(f"{path}: no such list of scenes; it is a text file with one name per line")
    if path.stat().st_size > _LARGEST_LIST:
        raise ValueError(f"{path}: {path.stat().st_size} bytes are too many for a list of scenes (limit {_LARGEST_LIST})")
    try:
        lines = [line.strip() for line in path.read_text(encoding="utf-8").splitlines()]
    except ValueError as error:
        raise ValueError(f"{path}: not a text file ({error}); one scene name per line is expected") from error
    names = [line for line in lines if line and not line.startswith("#")]
    if not names:
        raise ValueError(f"{path}: lists no scenes")
    if long := next((name for name in names if len(name) > _LONGEST_NAME or not name.isprintable()), None):
        raise ValueError(f"{path}: '{long[:40]!r}...' is no name of a scene; is this a list with one name per line?")
    if len(set(names)) < len(names):
        twice = sorted(name for name, count in Counter(names).items() if count > 1)
        raise ValueError(f"{path}: lists {_some('scene', twice)} more than once")
    return names


def no_split(split: SplitChoice | None, where: str, remedy: str) -> None:
    """Refuse a split for a format that has none.

    Raises:
        ValueError: a split was asked for.
    """
    if split is not None:
        raise ValueError(f"{where}: this format has no split '{split}': {remedy}")


def _named(split: str, available: Sequence[str], where: str) -> frozenset[str]:
    data_set = data_set_of(available)
    if data_set is None:
        raise ValueError(
            f"{where}: no split '{split}' is known for its scenes ({_some('', list(available))}): only nuScenes and Lyft have "
            "lists here; name the scenes in a text file, one per line, and give its name (ending in .txt)"
        )
    splits = known_splits()[data_set]
    if split not in splits:
        raise ValueError(f"{where}: {data_set} has no split '{split}', only {', '.join(splits)}")
    return splits[split]


def _some(what: str, names: Sequence[str]) -> str:
    more = f" and {len(names) - _SHOWN} more" if len(names) > _SHOWN else ""
    return f"{what} {', '.join(names[:_SHOWN])}{more}".strip()
