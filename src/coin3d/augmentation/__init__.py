"""Changes made to training frames. Every change of pixels or places is followed by the cameras and the boxes."""

from coin3d.augmentation.bev import BevAugmentation, transform_boxes
from coin3d.augmentation.focal import FocalAugmentation
from coin3d.augmentation.image import ImageAugmentation
from coin3d.augmentation.view import View, ViewAugmentation

__all__ = ["BevAugmentation", "FocalAugmentation", "ImageAugmentation", "View", "ViewAugmentation", "transform_boxes"]
