// The manifest of a model file of edgetree: one JSON text in the metadata of the ONNX file.
#pragma once

#include <optional>
#include <string>

struct DepthEncoding {
    double near_m, far_m;
    int near_value, far_value, invalid_value;
};

struct Manifest {
    std::string input;  // name of the graph's only input
    int width, height;  // of the input in pixels
    int channels;       // 3 for BGR, 1 for encoded depth
    int pad_value;
    double mask_overlap;
    std::optional<DepthEncoding> depth;
    bool has_keypoints, has_masks;
};

// Throws std::runtime_error if the file is not a model of edgetree.
Manifest read_manifest(const std::string& model);
