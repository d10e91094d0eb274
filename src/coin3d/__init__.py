"""CoIn3D: multi-camera 3D object detection that transfers to camera rigs it was never trained on.

The whole story in five lines::

    import coin3d

    detector = coin3d.load("town-coin3d")  # a shipped name, or the path of a checkpoint
    rig = coin3d.load_rig("van/rig.yaml")  # what the cameras are and where they sit: docs/your_rig.md
    boxes = detector.detect({"front": "van/front.jpg", "rear": "van/rear.jpg"}, rig)
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from coin3d.datasets.open import open_recording
    from coin3d.geometry import Boxes3D, Rig, load_rig, preset_rig
    from coin3d.inference import LoadedDetector, load

# imported when asked for: `import coin3d` must not cost the seconds that torch takes
_HOMES = {
    "Boxes3D": "coin3d.geometry",
    "LoadedDetector": "coin3d.inference",
    "Rig": "coin3d.geometry",
    "load": "coin3d.inference",
    "load_rig": "coin3d.geometry",
    "open_recording": "coin3d.datasets.open",
    "preset_rig": "coin3d.geometry",
}

__all__ = ["Boxes3D", "LoadedDetector", "Rig", "load", "load_rig", "open_recording", "preset_rig"]


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module 'coin3d' has no attribute '{name}'; it has {', '.join(__all__)}")
    return getattr(importlib.import_module(_HOMES[name]), name)


def __dir__() -> list[str]:
    return sorted([*globals(), *__all__])
