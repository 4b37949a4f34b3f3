"""Evaluation of detectors: COCO's AP, errors in pixels, results by condition, HTML report."""

from perceptree.evaluation.coco_matching import OKS_SIGMAS
from perceptree.evaluation.figures import About
from perceptree.evaluation.metrics import Metrics, evaluate
from perceptree.evaluation.predictions import (
    Chances,
    FramePrediction,
    Predict,
    RawDetections,
    on_device,
    predict_frames,
    predict_images,
    predict_with,
    read_ahead,
)
from perceptree.evaluation.report import Report, make_report, report_folder
from perceptree.evaluation.summary import summary_lines

__all__ = [
    "OKS_SIGMAS",
    "About",
    "Chances",
    "FramePrediction",
    "Metrics",
    "Predict",
    "RawDetections",
    "Report",
    "evaluate",
    "make_report",
    "on_device",
    "predict_frames",
    "predict_images",
    "predict_with",
    "read_ahead",
    "report_folder",
    "summary_lines",
]
