// Leaves out trees beyond the reach of the model's labels, by depth and camera.
#pragma once

#include <optional>
#include <vector>

#include "json.hpp"
#include "trees.hpp"

// The camera of a kit's frame, if it is given.
std::optional<Camera> camera_of(const Json& frame);

// The trees with their scores times the chance that they stand within reach, without those that fall
// below the threshold. All trees as they are if the frame has no camera or no depth, or if it is not
// known how far trees were labelled.
std::vector<Tree> within_reach(std::vector<Tree> trees, const Manifest& manifest,
                               const Frame& frame, double score_threshold);
