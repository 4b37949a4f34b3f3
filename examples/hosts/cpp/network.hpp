// Runs the network. Only this file's implementation knows the runtime.
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "manifest.hpp"

// The outputs for one image, in pixels of the model's input; rows from `count` on are unused.
struct Outputs {
    int count = 0;
    int keypoints = 0;  // per tree
    int mask_size = 0;  // a mask has mask_size x mask_size cells
    std::vector<float> boxes, scores, points, masks;
};

class Network {
public:
    Network(const std::string& model, const Manifest& manifest, int threads);
    ~Network();
    Outputs run(std::vector<std::vector<std::uint8_t>>& inputs);  // in the manifest's order
    static std::string runtime();
    static std::string version();

private:
    struct Session;
    std::unique_ptr<Session> session_;
};
