"""Reading files that other programs wrote with ``torch.save``: numbers only, no code of theirs is ever run."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

_BOOKKEEPING = (
    "mmengine.logging.history_buffer.HistoryBuffer",  # loss curves, in files of mmdet3d
    "numpy.core.multiarray._reconstruct",  # arrays and numbers in curves and run information; numpy 2 has another path
    "numpy.core.multiarray.scalar",
    "numpy._core.multiarray._reconstruct",
    "numpy._core.multiarray.scalar",
    "numpy.ndarray",
    "numpy.dtype",
)
"""What else than tensors released files hold beside their weights."""


class _Ignored:
    """Stands in for an object of the file that is no weight: takes whatever it is given and does nothing with it."""

    def __init__(self, *_: Any) -> None:
        pass

    def __setstate__(self, _: Any) -> None:
        pass


def _stand_in(path: str) -> Callable[..., Any]:
    module, _, name = path.rpartition(".")
    return type(name, (_Ignored,), {"__module__": module})


_STAND_INS: list[Any] = [_stand_in(path) for path in _BOOKKEEPING]


def read_released(path: Path) -> dict[str, Tensor]:
    """The weights of a released file by their names: a plain state dict, or the ``state_dict`` of a training program.

    Raises:
        FileNotFoundError: no such file.
        ValueError: not such a file, an incomplete one, one that holds program code, or weights that are no numbers.
    """
    if not path.exists():
        raise FileNotFoundError(f"{path}: no such file; give the .pth or .ckpt that was released")
    if path.is_dir():
        raise ValueError(f"{path} is a folder; give the .pth or .ckpt file in it")
    try:
        with torch.serialization.safe_globals(_STAND_INS):
            content = torch.load(path, map_location="cpu", weights_only=True)
    except OSError:
        raise
    except Exception as error:  # bytes that are something else can trip the reader anywhere
        raise ValueError(_refusal(path, str(error))) from error
    state = content.get("state_dict", content) if isinstance(content, dict) else content
    if not isinstance(state, dict) or not state:
        raise ValueError(f"{path}: holds no named weights; a state dict or a file with 'state_dict' is needed")
    for name, value in state.items():
        _check(path, name, value)
    prefix = "module."  # of weights saved while several GPUs trained them
    return {name.removeprefix(prefix): value for name, value in state.items()}


def _check(path: Path, name: Any, value: Any) -> None:
    if not isinstance(name, str) or not isinstance(value, Tensor):
        kind = type(value).__name__ if isinstance(name, str) else "name that is no text"
        raise ValueError(f"{path}: '{name}' is a {kind} and no weight; a state dict or a file with 'state_dict' is needed")
    plain = value.layout is torch.strided and not value.is_quantized and not value.is_complex()
    if not plain or not bool(torch.isfinite(value).all()):
        raise ValueError(f"{path}: '{name}' holds numbers no network can use (not finite, complex, sparse or quantised)")


def _refusal(path: Path, reason: str) -> str:
    if found := re.search(r"GLOBAL (\S+)", reason):
        return (
            f"{path}: asks for '{found[1]}' to be run, which is no weight; nothing of it was run. Get the file from its "
            "publisher, or have the program that wrote it save the state dict alone"
        )
    return f"{path}: not a complete file of torch.save; it may be truncated or something else, get it again"
