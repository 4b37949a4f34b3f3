"""Numba kernels that rasterise triangles into a depth buffer and a face buffer.

Screen coordinates are corner-based pixels: (0, 0) is the outer corner of the first pixel, and
samples are at pixel centres. Results do not depend on the number of threads, because each band of
rows is drawn by one thread in the order of the faces.
"""

from __future__ import annotations

import numpy as np
from numba import njit, prange

from perceptree.simulator.materials.layers import SIZE_PX
from perceptree.simulator.rendering.kernel_math import face_texels, is_cutout, mip_level

BANDS = 8  # bands of rows that are drawn in parallel
NEAR_PLANE_M = np.float32(0.05)
_COARSEST = 6  # mip level of distant cut-outs
_SIZE = SIZE_PX
_f32 = np.float32


@njit(parallel=True, cache=True, error_model="numpy")
def project_vertices(vertices, camera, screen):
    """Project vertices by a pinhole camera.

    Args:
        vertices: (V, 3) float32 world points, m.
        camera: Camera of the samples.
        screen: (V, 3) float32, receives x px, y px and 1 / z; -1 for the last one where a vertex
            is behind the near plane.
    """
    rotation, origin = camera.rotation, camera.origin
    for i in prange(vertices.shape[0]):
        x = vertices[i, 0] - origin[0]
        y = vertices[i, 1] - origin[1]
        z = vertices[i, 2] - origin[2]
        depth = rotation[2, 0] * x + rotation[2, 1] * y + rotation[2, 2] * z
        if depth > NEAR_PLANE_M:
            inverse = _f32(1) / depth
            right = rotation[0, 0] * x + rotation[0, 1] * y + rotation[0, 2] * z
            down = rotation[1, 0] * x + rotation[1, 1] * y + rotation[1, 2] * z
            screen[i, 0] = right * inverse * camera.focal_x + camera.centre_x
            screen[i, 1] = down * inverse * camera.focal_y + camera.centre_y
            screen[i, 2] = inverse
        else:
            screen[i, 2] = _f32(-1)


@njit(parallel=True, cache=True, error_model="numpy")
def project_parallel(vertices, rows, screen):
    """Project vertices (V, 3) in parallel by a (3, 4) matrix.

    `screen` (V, 3) receives x px, y px and a nearness between 0 and 1.
    """
    for i in prange(vertices.shape[0]):
        x, y, z = vertices[i, 0], vertices[i, 1], vertices[i, 2]
        for k in range(3):
            screen[i, k] = rows[k, 0] * x + rows[k, 1] * y + rows[k, 2] * z + rows[k, 3]


@njit(parallel=True, cache=True, error_model="numpy")
def bin_faces(screen, faces, width, height, counts, lists):
    """List the faces whose bounding boxes overlap each band of rows, in order.

    Args:
        screen: (V, 3) projected vertices.
        faces: (F, 3) vertex numbers.
        width: Columns of the image.
        height: Rows of the image.
        counts: (bands,) receives the number of faces of each band.
        lists: (bands, F) receives the faces of each band.
    """
    for band in prange(counts.shape[0]):
        top = band * height // counts.shape[0]
        bottom = (band + 1) * height // counts.shape[0]
        count = 0
        for face in range(faces.shape[0]):
            i, j, k = faces[face, 0], faces[face, 1], faces[face, 2]
            if screen[i, 2] <= 0 or screen[j, 2] <= 0 or screen[k, 2] <= 0:
                continue
            y0, y1, y2 = screen[i, 1], screen[j, 1], screen[k, 1]
            if max(y0, max(y1, y2)) < top or min(y0, min(y1, y2)) >= bottom:
                continue
            x0, x1, x2 = screen[i, 0], screen[j, 0], screen[k, 0]
            if max(x0, max(x1, x2)) < 0 or min(x0, min(x1, x2)) >= width:
                continue
            lists[band, count] = face
            count += 1
        counts[band] = count


@njit(inline="always", cache=True, error_model="numpy")
def _cutout(triangles, i, j, k, area, texture):
    """Size, first texel and alpha threshold of the mip level for a cut-out face."""
    level = mip_level(face_texels(triangles.uv, 0, i, j, k) / abs(area), _f32(2), _COARSEST)
    size = _SIZE >> level
    threshold = _f32(127.5) / (_f32(1) + _f32(0.28) * level)
    return size, triangles.offsets[level] + texture * size * size, threshold


@njit(cache=True, error_model="numpy")
def _draw_face(face, top, bottom, triangles, depth_buffer, face_buffer):
    """Draw one face into the rows `top` to `bottom`."""
    faces, screen, uv = triangles.faces, triangles.screen, triangles.uv
    i, j, k = faces[face, 0], faces[face, 1], faces[face, 2]
    x0, y0, w0 = screen[i, 0], screen[i, 1], screen[i, 2]
    x1, y1, w1 = screen[j, 0], screen[j, 1], screen[j, 2]
    x2, y2, w2 = screen[k, 0], screen[k, 1], screen[k, 2]
    area = (x1 - x0) * (y2 - y0) - (x2 - x0) * (y1 - y0)
    if abs(area) < _f32(1e-6):
        return
    left = max(0, int(np.ceil(min(x0, min(x1, x2)) - _f32(0.5))))
    right = min(depth_buffer.shape[1] - 1, int(np.floor(max(x0, max(x1, x2)) - _f32(0.5))))
    first = max(top, int(np.ceil(min(y0, min(y1, y2)) - _f32(0.5))))
    last = min(bottom - 1, int(np.floor(max(y0, max(y1, y2)) - _f32(0.5))))
    texture = int(triangles.layer[face])
    cutout = is_cutout(texture)
    size, base, threshold = _SIZE, 0, _f32(0)
    if cutout and left <= right and first <= last:
        size, base, threshold = _cutout(triangles, i, j, k, area, texture)
    inverse = _f32(1) / area
    a_dx, a_dy = (y1 - y2) * inverse, (x2 - x1) * inverse
    b_dx, b_dy = (y2 - y0) * inverse, (x0 - x2) * inverse
    for y in range(first, last + 1):
        px, py = left + _f32(0.5) - x2, y + _f32(0.5) - y2
        a = px * a_dx + py * a_dy
        b = px * b_dx + py * b_dy
        for x in range(left, right + 1):
            c = _f32(1) - a - b
            nearness = a * w0 + b * w1 + c * w2
            if a >= 0 and b >= 0 and c >= 0 and nearness > depth_buffer[y, x]:
                visible = True
                if cutout:
                    pa, pb, pc, scale = a, b, c, _f32(size)
                    if triangles.perspective:
                        pa, pb, pc, scale = a * w0, b * w1, c * w2, size / nearness
                    column = int((pa * uv[i, 0] + pb * uv[j, 0] + pc * uv[k, 0]) * scale)
                    row = int((pa * uv[i, 1] + pb * uv[j, 1] + pc * uv[k, 1]) * scale)
                    texel = base + (row & (size - 1)) * size + (column & (size - 1))
                    visible = triangles.alpha[texel] > threshold
                if visible:
                    depth_buffer[y, x] = nearness
                    face_buffer[y, x] = face
            a += a_dx
            b += b_dx


@njit(parallel=True, cache=True, error_model="numpy")
def draw_faces(triangles, counts, lists, depth_buffer, face_buffer):
    """Rasterise faces.

    Cut-out layers are tested against their alpha at a mip level that fits their size on the
    screen. The threshold decreases with the level, so that foliage does not vanish with distance.

    Args:
        triangles: The triangles.
        counts: (bands,) number of faces of each band.
        lists: (bands, F) faces of each band.
        depth_buffer: (H, W) float32, receives the largest 1 / z (or nearness), 0 where empty.
        face_buffer: (H, W) int32, receives the face of it, -1 where empty.
    """
    height = depth_buffer.shape[0]
    for band in prange(counts.shape[0]):
        top = band * height // counts.shape[0]
        bottom = (band + 1) * height // counts.shape[0]
        depth_buffer[top:bottom] = _f32(0)
        face_buffer[top:bottom] = -1
        for entry in range(counts[band]):
            _draw_face(lists[band, entry], top, bottom, triangles, depth_buffer, face_buffer)
