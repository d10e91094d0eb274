"""``coin3d convert`` refuses in one line, and then writes nothing; its help and page know all sources."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch

from coin3d import cli
from coin3d.commands.convert import convert
from coin3d.training.released.sources import SOURCES

PAGE = Path(__file__).resolve().parents[2] / "docs" / "convert.md"


def refusal(capsys: pytest.CaptureFixture[str], *words: str) -> str:
    assert cli.main(["convert", *words]) == 2
    told = capsys.readouterr()
    assert told.err.count("\n") == 1 and told.err.startswith("coin3d: error: ")
    return told.err


@pytest.mark.parametrize(
    ("content", "words", "message"),
    [
        (None, [], "no such file"),
        (b"not weights", [], "not a complete file of torch.save"),
        ({"state_dict": {"roi_head.weight": torch.ones(1)}}, [], "'roi_head.weight' are of no network that can be converted"),
        ({"roi_head.weight": torch.ones(1)}, ["--from", "petr-vov"], "'roi_head.weight' is no weight of the released PETR-VoV"),
        ({"w": torch.ones(1)}, ["--from", "yolo"], "no released weights are called 'yolo'; there are coin3d-nuscenes, "),
        ({"w": 3}, [], "'w' is a int and no weight"),
        ({"img_neck.fpn_convs.0.conv.bias": torch.ones(512)}, ["--from", "coin3d-lyft"], "the file lacks the weight for"),
    ],
)
def test_one_line_and_nothing_written(
    content: object, words: list[str], message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path, out = tmp_path / "released.pth", tmp_path / "out" / "weights.safetensors"
    if isinstance(content, bytes):
        path.write_bytes(content)
    elif content is not None:
        torch.save(content, path)
    told = refusal(capsys, str(path), str(out), *words)
    assert message in told and (str(path) in told or "yolo" in told)
    assert not out.parent.exists()


def test_where_a_checkpoint_cannot_go(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    torch.save({"w": torch.ones(1)}, tmp_path / "released.pth")
    (tmp_path / "folder.safetensors").mkdir()
    for out in ("weights.pth", "folder.safetensors"):
        assert "ends in .safetensors" in refusal(capsys, str(tmp_path / "released.pth"), str(tmp_path / out))


@pytest.mark.parametrize("name", [source.name for source in SOURCES])
def test_every_source_is_in_the_help_and_on_the_page(name: str) -> None:
    assert name in str(convert.__doc__) and f"| `{name}` |" in PAGE.read_text(encoding="utf-8")
