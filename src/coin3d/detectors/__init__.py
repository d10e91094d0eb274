"""Detectors: each is one file, built from the parts beside it, and reached by methods through ``method.Method`` only."""

from coin3d.detectors.batch import Batch
from coin3d.detectors.bevdepth import BEVDepth
from coin3d.detectors.bevdepth_config import BEVDepthConfig
from coin3d.detectors.inputs import Sample, collate, frame_sample
from coin3d.detectors.method import Method

DETECTORS = {"bevdepth": (BEVDepthConfig, BEVDepth)}
"""Name -> (configuration class, detector class)."""

__all__ = ["DETECTORS", "BEVDepth", "BEVDepthConfig", "Batch", "Method", "Sample", "collate", "frame_sample"]
