"""Changes made to training frames. Every change of pixels or places is followed by the cameras and the boxes."""

from coin3d.augmentation.array_change import ArrayChange
from coin3d.augmentation.bev import BevAugmentation, transform_boxes
from coin3d.augmentation.focal import FocalAugmentation
from coin3d.augmentation.image import ImageAugmentation
from coin3d.augmentation.novel_view import NovelViewOptions, NovelViews, novel_views
from coin3d.augmentation.rig_sampler import RigSampler
from coin3d.augmentation.view import FrameAugmentation, RecordedImage, View, ViewAugmentation

__all__ = [
    "ArrayChange",
    "BevAugmentation",
    "FocalAugmentation",
    "FrameAugmentation",
    "ImageAugmentation",
    "NovelViewOptions",
    "NovelViews",
    "RecordedImage",
    "RigSampler",
    "View",
    "ViewAugmentation",
    "novel_views",
    "transform_boxes",
]
