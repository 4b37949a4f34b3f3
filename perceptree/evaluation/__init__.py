"""How good a detector is: COCO's measures, errors in pixels, by conditions, as a page."""

from perceptree.evaluation.metrics import Metrics, evaluate
from perceptree.evaluation.precision import OKS_SIGMAS
from perceptree.evaluation.predictions import (
    FramePrediction,
    Predict,
    RawDetections,
    predict_frames,
    predict_images,
    predict_with,
    read_ahead,
)

__all__ = [
    "OKS_SIGMAS",
    "FramePrediction",
    "Metrics",
    "Predict",
    "RawDetections",
    "evaluate",
    "predict_frames",
    "predict_images",
    "predict_with",
    "read_ahead",
]
