"""Faults of a rig, put into the frames of a drive: each changes a frame, given the one before."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import cv2
import numpy as np

from calib import PinholeCamera, RigidTransform
from edgetree.frames.frame import Frame

Change = Callable[[Frame, Frame], Frame]


def warped(x: float = 0, y: float = 0, size: float = 1, turn: float = 0) -> Change:
    """Depth shifted (px right and down), resized and turned (degrees clockwise)."""

    def change(frame: Frame, _: Frame) -> Frame:
        assert frame.depth_m is not None
        height, width = frame.depth_m.shape
        matrix = cv2.getRotationMatrix2D(((width - 1) / 2, (height - 1) / 2), -turn, size)
        matrix[:, 2] += np.array([x, y])
        nearest = cv2.INTER_NEAREST
        new = cv2.warpAffine(frame.depth_m, matrix, (width, height), flags=nearest)
        return replace(frame, depth_m=np.asarray(new, np.float32))

    return change


def parallax(error_m: float) -> Change:
    """Depth as registered with a baseline that is too large: shifted right by f b / z."""

    def change(frame: Frame, _: Frame) -> Frame:
        assert frame.depth_m is not None
        assert frame.camera is not None
        rows, columns = np.nonzero(frame.depth_m)
        depth = frame.depth_m[rows, columns]
        moved = np.rint(columns + frame.camera.fx * error_m / depth).astype(int)
        inside = moved < frame.depth_m.shape[1]
        far_first = np.argsort(-depth[inside], kind="stable")
        new = np.zeros_like(frame.depth_m)
        new[rows[inside][far_first], moved[inside][far_first]] = depth[inside][far_first]
        return replace(frame, depth_m=new)

    return change


def late(frame: Frame, before: Frame) -> Frame:
    """The depth of the frame before."""
    return replace(frame, depth_m=before.depth_m)


def tilted(angle_deg: float, axis: int) -> Change:
    """A vertical that is turned so that stems seem to lean away (axis 0) or to the left (2)."""
    vector = np.zeros(3)
    vector[axis] = math.radians(angle_deg)
    matrix = cv2.Rodrigues(vector)[0]

    def change(frame: Frame, _: Frame) -> Frame:
        assert frame.up_camera is not None
        return replace(frame, up_camera=matrix @ frame.up_camera)

    return change


def scaled(factor: float) -> Change:
    """Depth that is too large by a factor."""

    def change(frame: Frame, _: Frame) -> Frame:
        assert frame.depth_m is not None
        return replace(frame, depth_m=frame.depth_m * np.float32(factor))

    return change


def focal(factor: float) -> Change:
    """A focal length that is too large by a factor."""

    def change(frame: Frame, _: Frame) -> Frame:
        assert frame.camera is not None
        data = frame.camera.to_dict()
        data |= {"fx": data["fx"] * factor, "fy": data["fy"] * factor}
        return replace(frame, camera=PinholeCamera.from_dict(data))

    return change


def heading(angle_deg: float) -> Change:
    """Poses whose heading is too far left."""
    turn = cv2.Rodrigues(np.array([0.0, 0.0, math.radians(angle_deg)]))[0]

    def change(frame: Frame, _: Frame) -> Frame:
        assert frame.pose is not None
        pose = RigidTransform(turn @ frame.pose.rotation, frame.pose.translation_m)
        return replace(frame, pose=pose)

    return change


def hanging(frame: Frame, before: Frame) -> Frame:
    """Every tenth depth is the one before."""
    assert frame.number is not None
    return late(frame, before) if frame.number % 10 == 9 else frame
