// From a frame to the model's input, as the manifest says.
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "manifest.hpp"

// A pinhole camera without distortion, in px; (0, 0) is the middle of the first pixel.
struct Camera {
    double fx, fy, cx, cy;
};

// BGR bytes for an rgb model; 16-bit millimetres, 0 = no reading, for a depth model. For a model of
// both, one of them may be empty. With a camera, trees beyond the model's reach can be left out.
struct Frame {
    int width, height;
    std::vector<std::uint8_t> bgr;
    std::vector<std::uint16_t> depth_mm;
    std::optional<Camera> camera = std::nullopt;
};

// Where a frame lies in the model's input: at the top left, resized to this size.
struct Letterbox {
    int width, height;
    double scale_x, scale_y;  // model px per frame px
};

Letterbox fit(int width, int height, const Manifest& manifest);

// Makes the model's inputs, height x width x channels bytes each, from frames.
class Preparation {
public:
    explicit Preparation(const Manifest& manifest);
    std::vector<std::vector<std::uint8_t>> inputs_of(const Frame& frame) const;

private:
    std::vector<std::uint8_t> input_of(const Frame& frame, const Input& input) const;

    Manifest manifest_;
    std::vector<std::uint8_t> grey_;  // of each depth in millimetres
};
