"""What is particular about the files of Lyft Level 5, beside tables that nuScenes readers understand."""

from __future__ import annotations

from pathlib import Path

from coin3d.datasets.inside import inside

ZOOMED_CAMERA = "CAM_FRONT_ZOOMED"
"""A seventh camera with a long lens that only some vehicles have; left out unless it is asked for."""

CUT_SHORT = "host-a011_lidar1_1233090652702363606.bin"
"""The one LiDAR file of the published set whose last point lacks two of its five numbers."""

_AS_DOWNLOADED = {"images": "train_images", "lidar": "train_lidar", "maps": "train_maps"}


def data_root(root: Path, table_folder: Path, filename: str) -> Path:
    """The folder that the file names of the tables are relative to.

    Lyft's tables may lie at ``v1.01-train/v1.01-train`` with the images beside the outer or beside the inner folder.

    Args:
        root: the folder that was opened.
        table_folder: the folder with the tables, in or below it.
        filename: of any sample, as the table has it.
    """
    first = filename.partition("/")[0] if _is_name_inside(root, filename) else ""
    places = [table_folder.parent] if table_folder == root else [root, table_folder.parent, table_folder.parent.parent]
    for place in places:
        if first and any((place / folder).is_dir() for folder in (first, _AS_DOWNLOADED.get(first, first))):
            return place
    return places[0]


def _is_name_inside(root: Path, filename: str) -> bool:
    try:
        inside(root, filename, "filename")
    except ValueError:  # says so where the file is asked for
        return False
    return True


def locate(root: Path, filename: str) -> Path:
    """A file of the tables on disk; ``images/x`` is ``train_images/x`` where the download was left as it came."""
    first, _, rest = filename.partition("/")
    unpacked = _AS_DOWNLOADED.get(first)
    if unpacked is not None and not (root / first).is_dir() and (root / unpacked).is_dir():
        return root / unpacked / rest
    return root / filename
