"""How good a detector is, by the standard COCO measures."""

from perceptree.evaluation.metrics import OKS_SIGMAS, Metrics, evaluate
from perceptree.evaluation.predictions import (
    FramePrediction,
    Predict,
    RawDetections,
    predict_frames,
    predict_with,
)

__all__ = [
    "OKS_SIGMAS",
    "FramePrediction",
    "Metrics",
    "Predict",
    "RawDetections",
    "evaluate",
    "predict_frames",
    "predict_with",
]
