"""Files of other programs: their numbers are read, what else they hold is not run, and what is no such file is refused."""

from __future__ import annotations

import pickle
import sys
import types
from collections import OrderedDict
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from coin3d.training.released.released_file import read_released

STATE = OrderedDict({"conv.weight": torch.arange(6.0).reshape(2, 3), "bn.num_batches_tracked": torch.tensor(7)})


def saved(path: Path, content: Any, **how: Any) -> Path:
    torch.save(content, path, **how)
    return path


class Evil:
    """Unpickling it would create a file."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def __reduce__(self) -> Any:
        return open, (str(self.path), "w")


@pytest.mark.parametrize(
    "content",
    [
        STATE,
        {"state_dict": STATE},
        {"state_dict": {f"module.{name}": tensor for name, tensor in STATE.items()}},
        {"meta": {"epoch": 24, "config": "text", "CLASSES": ("car",)}, "state_dict": STATE, "optimizer": {"lr": 1.0}},
        {"epoch": 24, "state_dict": STATE, "updates": 1},
    ],
    ids=["plain", "state_dict", "of several GPUs", "mmcv", "average"],
)
@pytest.mark.parametrize("zipped", [True, False])
def test_kinds_of_files(content: Any, zipped: bool, tmp_path: Path) -> None:
    found = read_released(saved(tmp_path / "w.pth", content, _use_new_zipfile_serialization=zipped))
    assert list(found) == list(STATE) and all(torch.equal(found[name], STATE[name]) for name in STATE)


def test_bookkeeping_of_mmengine_is_passed_over(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its loss curves are objects with arrays; the file is written by the class and read without it."""
    name = "mmengine.logging.history_buffer"
    module = types.ModuleType(name)
    history = type("HistoryBuffer", (), {"__module__": name})
    module.HistoryBuffer = history  # type: ignore[attr-defined]
    with monkeypatch.context() as patch:
        for part in ("mmengine", "mmengine.logging", name):
            patch.setitem(sys.modules, part, module)
        curve = history()
        curve.__dict__.update(max_length=1000, _log_history=np.arange(3.0), _count_history=np.arange(3))
        hub = {"log_scalars": {"train/loss": curve}, "runtime_info": {"iter": np.int64(3), "lr": np.float64(0.1)}}
        path = saved(tmp_path / "w.pth", {"message_hub": hub, "state_dict": STATE}, _use_new_zipfile_serialization=False)
    assert list(read_released(path)) == list(STATE)
    content = path.read_bytes()
    assert b"numpy._core.multiarray" in content and name.encode() in content and name not in sys.modules
    path.write_bytes(content.replace(b"numpy._core.multiarray", b"numpy.core.multiarray"))  # as numpy 1 calls it
    assert list(read_released(path)) == list(STATE)


@pytest.mark.parametrize("place", ["meta", "state_dict", "whole"])
def test_code_in_a_file_is_not_run(place: str, tmp_path: Path) -> None:
    created = tmp_path / "created"
    content: Any = {"state_dict": STATE, "meta": {}, place: Evil(created)} if place != "whole" else Evil(created)
    path = saved(tmp_path / "w.pth", content)
    with pytest.raises(ValueError, match=r"w\.pth: asks for '[\w.]*open' to be run, .* nothing of it was run"):
        read_released(path)
    assert not created.exists()
    with path.open("rb") as file:  # the same file does harm where it is trusted
        torch.load(file, weights_only=False)
    assert created.exists()


def test_code_that_is_blocked_by_name(tmp_path: Path) -> None:
    class System:
        def __reduce__(self) -> Any:
            import os

            return os.system, (f"touch {tmp_path / 'created'}",)

    for path in (tmp_path / "w.pth", tmp_path / "w.pkl"):
        if path.suffix == ".pth":
            torch.save({"state_dict": STATE, "x": System()}, path)
        else:
            path.write_bytes(pickle.dumps({"state_dict": System()}, protocol=2))
        with pytest.raises(ValueError, match=r"(posix|nt)\.system|not a complete file"):
            read_released(path)
    assert not (tmp_path / "created").exists()


def test_files_that_are_something_else(tmp_path: Path) -> None:
    import zipfile

    with pytest.raises(FileNotFoundError, match=r"absent\.pth: no such file"):
        read_released(tmp_path / "absent.pth")
    with pytest.raises(ValueError, match="is a folder"):
        read_released(tmp_path)
    others = {"text": b"weights are over there\n", "empty": b"", "picture": b"\x89PNG\r\n\x1a\n" + bytes(100)}
    for name, content in others.items():
        (tmp_path / name).write_bytes(content)
    with zipfile.ZipFile(tmp_path / "zip", "w") as archive:
        archive.writestr("data/readme.txt", "no pickle here")
    whole = saved(tmp_path / "w.pth", {"state_dict": STATE}).read_bytes()
    for keep in (1, 100, len(whole) // 2, len(whole) - 1):
        (tmp_path / f"cut{keep}").write_bytes(whole[:keep])
    for path in tmp_path.iterdir():
        if path.name != "w.pth":
            with pytest.raises(ValueError, match=rf"{path.name}: not a complete file of torch\.save"):
                read_released(path)


@pytest.mark.filterwarnings("ignore:Validating sparse")
@pytest.mark.parametrize(
    ("content", "message"),
    [
        (torch.ones(3), "holds no named weights"),
        ([STATE], "holds no named weights"),
        ({}, "holds no named weights"),
        ({"state_dict": {}}, "holds no named weights"),
        ({"model": STATE}, "'model' is a OrderedDict and no weight"),
        ({"epoch": 3, **STATE}, "'epoch' is a int and no weight"),
        ({"state_dict": {7: torch.ones(1)}}, "'7' is a name that is no text"),
        ({"w": torch.tensor([1.0, float("nan")])}, "'w' holds numbers no network can use"),
        ({"w": torch.ones(2, dtype=torch.complex64)}, "'w' holds numbers no network can use"),
        ({"w": torch.eye(3).to_sparse()}, "'w' holds numbers no network can use"),
    ],
)
def test_content_that_is_no_state(content: Any, message: str, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=message):
        read_released(saved(tmp_path / "w.pth", content))


@given(at=st.integers(0, 10**6), value=st.integers(0, 255))
def test_a_changed_byte_gives_weights_or_one_error(at: int, value: int, tmp_path_factory: pytest.TempPathFactory) -> None:
    folder = tmp_path_factory.mktemp("changed")
    content = bytearray(saved(folder / "w.pth", {"state_dict": STATE}).read_bytes())
    content[at % len(content)] = value
    (folder / "w.pth").write_bytes(bytes(content))
    try:
        found = read_released(folder / "w.pth")
    except ValueError as error:
        assert str(error).startswith(str(folder / "w.pth"))
    else:
        assert all(isinstance(tensor, torch.Tensor) for tensor in found.values())
