"""Released names to ours: complete, or an error that names the weight."""

import pytest
import torch

from coin3d.training.released.key_map import KeyMap

KEYS = KeyMap(
    "a released thing",
    (
        (r"old\.(.+)", r"new.\1"),
        (r"copy\d\.(.+)", r"new.\1"),
        (r"stage(\d)", lambda m: f"part.{int(m[1]) - 2}"),
    ),
    ((r"frustum", "computed from the input size"),),
)
OWN = {"new.weight": torch.zeros(2, 3), "new.num_batches_tracked": torch.tensor(0)}


def test_what_is_mapped_and_what_is_left_out() -> None:
    released = {"old.weight": torch.ones(2, 3).half(), "frustum": torch.zeros(9), "copy1.weight": torch.ones(2, 3).half()}
    state = KEYS.convert(released, OWN)
    assert torch.equal(state["new.weight"], torch.ones(2, 3)) and state["new.weight"].dtype == torch.float32
    assert state["new.num_batches_tracked"] == 0
    assert KEYS.reason("frustum") == "computed from the input size" and KEYS.name("frustum") is None
    assert KEYS.name("stage5") == "part.3"
    assert KEYS.unused(released) == {
        "frustum": "computed from the input size",
        "copy1.weight": "a copy of a weight that several layers share",
    }


@pytest.mark.parametrize(
    ("released", "message"),
    [
        ({}, "lacks the weight for 'new.weight'"),
        ({"old.weight": torch.zeros(2, 2)}, r"'old.weight' .* shape \(2, 2\), this detector needs \(2, 3\)"),
        ({"old.weight": torch.zeros(2, 3), "old.more": torch.zeros(1)}, "'old.more' .* 'new.more', which"),
        ({"other": torch.zeros(1)}, "'other' is no weight of a released thing"),
        ({"old.weight": torch.zeros(2, 3), "copy2.weight": torch.ones(2, 3)}, "'copy2.weight' differs from 'old.weight'"),
    ],
)
def test_what_does_not_fit_is_named(released: dict[str, torch.Tensor], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        KEYS.convert(released, OWN)
