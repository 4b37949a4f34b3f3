// The manifest of a model file of edgetree: one JSON text in the metadata of the ONNX file.
#pragma once

#include <optional>
#include <string>
#include <vector>

struct DepthEncoding {
    double near_m, far_m;
    int near_value, far_value, invalid_value;
};

// An input of the graph.
struct Input {
    std::string name;
    int channels;  // 3 for BGR, 1 for encoded depth
    int pad_value;
    // An image of this value alone stands for none; -1 if the image may not be missing.
    int nothing = -1;
};

struct Manifest {
    std::vector<Input> inputs;  // one, or colour and depth
    int width, height;          // of the inputs in pixels
    double mask_overlap;
    std::optional<DepthEncoding> depth;
    // How far trees were labelled; for depth alone, where a file has a model of its own for that.
    std::optional<double> reach_m, depth_reach_m;
    bool has_keypoints, has_masks;
};

// Throws std::runtime_error if the file is not a model of edgetree.
Manifest read_manifest(const std::string& model);
