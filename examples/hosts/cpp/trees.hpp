// From the model's outputs to the trees of a frame, as the manifest says.
#pragma once

#include <array>
#include <vector>

#include "network.hpp"
#include "prepare.hpp"

// A tree in pixels of the frame.
struct Tree {
    double score;
    std::array<double, 4> box;
    std::vector<std::array<double, 3>> keypoints;  // x, y, score
    std::vector<float> mask;                       // probabilities, row by row over the box
};

// By descending score.
std::vector<Tree> trees_of(const Outputs& outputs, const Manifest& manifest, const Frame& frame,
                           double score_threshold);
