"""Datasets: COCO files of tree frames, frames as model input, augmentation."""

from perceptree.data.augment import PAPER_AUGMENT, VARIED_AUGMENT, AugmentSettings, augment, flip
from perceptree.data.coco import SPLITS, FrameRecord, TreeRecord
from perceptree.data.dataset import Dataset, read_dataset, read_split
from perceptree.data.frames import FrameStore, Sample, read_frame

__all__ = [
    "PAPER_AUGMENT",
    "SPLITS",
    "VARIED_AUGMENT",
    "AugmentSettings",
    "Dataset",
    "FrameRecord",
    "FrameStore",
    "Sample",
    "TreeRecord",
    "augment",
    "flip",
    "read_dataset",
    "read_frame",
    "read_split",
]
