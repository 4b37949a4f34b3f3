#include "trees.hpp"

#include <algorithm>
#include <cmath>

namespace {

// A row of the outputs: its box in px of the model's input, and the cells of its mask.
struct Row {
    int index;
    const float* box;
    const float* mask;
    int inside;  // cells that belong to the tree
};

bool is_inside(float probability) { return probability > 0.5f; }

double area(const Row& row) {
    return row.inside * (double(row.box[2]) - row.box[0]) * (double(row.box[3]) - row.box[1]);
}

bool touch(const Row& a, const Row& b) {
    return std::min(a.box[2], b.box[2]) > std::max(a.box[0], b.box[0]) &&
           std::min(a.box[3], b.box[3]) > std::max(a.box[1], b.box[1]);
}

// The cell of `large` in which the centre of a cell of `small` lies, along one axis; -1 if outside.
int cell_of(const Row& small, const Row& large, int cell, int axis, int size) {
    const double low = small.box[axis], high = small.box[axis + 2];
    const double at = low + (cell + 0.5) * (high - low) / size;
    const double side = double(large.box[axis + 2]) - large.box[axis];
    const double place = std::floor((at - large.box[axis]) * size / side);
    return place >= 0 && place < size ? static_cast<int>(place) : -1;
}

// Common cells of two masks, as a share of the smaller one's.
double overlap(const Row& a, const Row& b, int size) {
    const bool swap = area(a) < area(b);
    const Row &small = swap ? a : b, &large = swap ? b : a;
    int common = 0;
    for (int row = 0; row < size; ++row) {
        const int there = cell_of(small, large, row, 1, size);
        if (there < 0) continue;
        for (int column = 0; column < size; ++column) {
            if (!is_inside(small.mask[row * size + column])) continue;
            const int across = cell_of(small, large, column, 0, size);
            common += across >= 0 && is_inside(large.mask[there * size + across]);
        }
    }
    return double(common) / std::max(small.inside, 1);
}

}  // namespace

std::vector<Tree> trees_of(const Outputs& outputs, const Manifest& manifest, const Frame& frame,
                           double score_threshold) {
    const Letterbox box = fit(frame.width, frame.height, manifest);
    const int size = outputs.mask_size, cells = size * size;
    std::vector<Row> kept;
    for (int i = 0; i < outputs.count; ++i) {
        Row row{i, &outputs.boxes[4 * i], nullptr, 0};
        const bool in_view =
            row.box[0] / box.scale_x < frame.width && row.box[1] / box.scale_y < frame.height;
        if (!in_view || outputs.scores[i] < score_threshold) continue;
        if (cells > 0) {
            row.mask = &outputs.masks[static_cast<std::size_t>(i) * cells];
            row.inside = static_cast<int>(std::count_if(row.mask, row.mask + cells, is_inside));
            // Of trees whose masks cover each other, the first has the highest score.
            if (std::any_of(kept.begin(), kept.end(), [&](const Row& other) {
                    return touch(other, row) && overlap(other, row, size) > manifest.mask_overlap;
                }))
                continue;
        }
        kept.push_back(row);
    }

    std::vector<Tree> trees;
    for (const Row& row : kept) {
        Tree tree{std::min(1.0, double(outputs.scores[row.index])),
                  {row.box[0] / box.scale_x, row.box[1] / box.scale_y, row.box[2] / box.scale_x,
                   row.box[3] / box.scale_y},
                  {},
                  {}};
        for (int k = 0; k < outputs.keypoints; ++k) {
            const float* point = &outputs.points[3 * (row.index * outputs.keypoints + k)];
            tree.keypoints.push_back({point[0] / box.scale_x, point[1] / box.scale_y, point[2]});
        }
        if (cells > 0) tree.mask.assign(row.mask, row.mask + cells);
        trees.push_back(std::move(tree));
    }
    return trees;
}
