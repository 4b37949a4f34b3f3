// Resizing of bytes that gives OpenCV's values exactly, since an 8-bit network answers to one grey.
#pragma once

#include <cstdint>
#include <functional>
#include <vector>

struct Size {
    int width, height;
};

// Gives a pointer to a source row of width x channels bytes, valid until the next call.
using RowOf = std::function<const std::uint8_t*(int)>;

// Resize a frame: the mean of areas if it becomes narrower, else bilinear interpolation. Row y goes
// to out + y * stride.
void resize(const RowOf& row_of, Size from, Size to, int channels, std::uint8_t* out,
            std::size_t stride);
