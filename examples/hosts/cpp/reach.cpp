// The network sees depth along the optical axis. How far a stem at the edge of a wide picture stands
// from the camera is computed here, as in edgetree/runtime/reach.py, which says where the numbers
// come from.
#include "reach.hpp"

#include <algorithm>
#include <cmath>

namespace {

constexpr double kDistanceStd = 0.015;  // of a stem's distance, relative to the reach
constexpr double kLeastRead = 0.3;      // share of a stem's cells with a reading that tells it
constexpr float kStem = 0.5f;           // probability from which on a cell belongs to the stem

// Millimetres of a pixel; 0 without a reading, and off the picture.
int depth_at(const Frame& frame, double x, double y) {
    if (!(x >= 0 && x < frame.width && y >= 0 && y < frame.height)) return 0;
    return frame.depth_mm[static_cast<std::size_t>(y) * frame.width + static_cast<std::size_t>(x)];
}

// Distance in metres from the camera to a stem's axis at the lower end of its box, if it is known.
std::optional<double> stem_distance(const Tree& tree, const Frame& frame, const Camera& camera) {
    const int size = static_cast<int>(std::lround(std::sqrt(tree.mask.size())));
    const auto cells_of = [&](int row) {
        const auto begin = tree.mask.begin() + row * size;
        return std::count_if(begin, begin + size, [](float value) { return value >= kStem; });
    };
    int first = 0, after = size;
    while (first < size && cells_of(first) == 0) ++first;
    if (first == size) return std::nullopt;
    while (cells_of(after - 1) == 0) --after;

    const double cell_x = (tree.box[2] - tree.box[0]) / size;
    const double cell_y = (tree.box[3] - tree.box[1]) / size;
    std::vector<int> readings;
    double cells = 0, rows = 0;
    for (int row = (first + after) / 2; row < after; ++row) {
        rows += cells_of(row) > 0;
        cells += static_cast<double>(cells_of(row));
        for (int column = 0; column < size; ++column) {
            if (tree.mask[row * size + column] < kStem) continue;
            const int depth = depth_at(frame, tree.box[0] + cell_x * (column + 0.5),
                                       tree.box[1] + cell_y * (row + 0.5));
            if (depth > 0) readings.push_back(depth);
        }
    }
    if (readings.size() < std::max(kLeastRead * cells, 1.0)) return std::nullopt;
    const auto middle = readings.begin() + static_cast<std::ptrdiff_t>(readings.size() - 1) / 2;
    std::nth_element(readings.begin(), middle, readings.end());
    const double x = ((tree.box[0] + tree.box[2]) / 2 - 0.5 - camera.cx) / camera.fx;
    const double y = (tree.box[3] - 0.5 - camera.cy) / camera.fy;
    const double stem_width = cells / rows * cell_x;
    return *middle / 1000.0 * (std::sqrt(x * x + y * y + 1) + 0.5 * stem_width / camera.fx);
}

}  // namespace

std::optional<Camera> camera_of(const Json& frame) {
    if (!frame.has("camera") || frame.at("camera").kind != Json::Kind::object) return std::nullopt;
    const Json& camera = frame.at("camera");
    return Camera{camera.num("fx"), camera.num("fy"), camera.num("cx"), camera.num("cy")};
}

std::vector<Tree> within_reach(std::vector<Tree> trees, const Manifest& manifest,
                               const Frame& frame, double score_threshold) {
    const auto reach_m = frame.bgr.empty() ? manifest.depth_reach_m : manifest.reach_m;
    if (!frame.camera || !reach_m || frame.depth_mm.empty()) return trees;
    for (Tree& tree : trees) {
        if (tree.mask.empty()) continue;
        const auto distance = stem_distance(tree, frame, *frame.camera);
        if (!distance) continue;
        const double near = (*reach_m - *distance) / (kDistanceStd * *reach_m);
        tree.score *= 0.5 * std::erfc(-near / std::sqrt(2.0));
    }
    std::erase_if(trees, [&](const Tree& tree) { return tree.score < score_threshold; });
    std::stable_sort(trees.begin(), trees.end(),
                     [](const Tree& a, const Tree& b) { return a.score > b.score; });
    return trees;
}
