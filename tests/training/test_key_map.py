"""Released names to ours: complete, or an error that names the weight."""

import pytest
import torch

from coin3d.training.released.key_map import KeyMap

KEYS = KeyMap("a released thing", ((r"old\.(.+)", r"new.\1"),), ((r"frustum", "computed from the input size"),))
OWN = {"new.weight": torch.zeros(2, 3), "new.num_batches_tracked": torch.tensor(0)}


def test_what_is_mapped_and_what_is_left_out() -> None:
    weight = torch.ones(2, 3)
    state = KEYS.convert({"old.weight": weight, "frustum": torch.zeros(9)}, OWN)
    assert state["new.weight"] is weight and state["new.num_batches_tracked"] == 0
    assert KEYS.reason("frustum") == "computed from the input size" and KEYS.name("frustum") is None


@pytest.mark.parametrize(
    ("released", "message"),
    [
        ({}, "lacks the weight for 'new.weight'"),
        ({"old.weight": torch.zeros(2, 2)}, r"'old.weight' .* shape \(2, 2\), this detector needs \(2, 3\)"),
        ({"old.weight": torch.zeros(2, 3), "old.more": torch.zeros(1)}, "'old.more' .* 'new.more', which"),
        ({"other": torch.zeros(1)}, "'other' is no weight of a released thing"),
    ],
)
def test_what_does_not_fit_is_named(released: dict[str, torch.Tensor], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        KEYS.convert(released, OWN)
