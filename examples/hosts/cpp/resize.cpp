#include "resize.hpp"

#include <algorithm>
#include <cmath>

namespace {

constexpr int one = 2048;  // fixed-point 1 of bilinear weights

// The source pixels that one resized pixel mixes, and their weights.
template <typename Weight>
struct Mixture {
    std::vector<int> sources;
    std::vector<Weight> weights;
};

// Mean of areas.
std::vector<Mixture<float>> areas(int from, int to) {
    const double step = static_cast<double>(from) / to;
    std::vector<Mixture<float>> all(to);
    for (int i = 0; i < to; ++i) {
        const double begin = i * step, end = begin + step, size = std::min(step, from - begin);
        const int last = std::min(static_cast<int>(std::floor(end)), from - 1);
        const int first = std::min(static_cast<int>(std::ceil(begin)), last);
        const auto add = [&](int source, double weight) {
            all[i].sources.push_back(source);
            all[i].weights.push_back(static_cast<float>(weight));
        };
        if (first - begin > 1e-3) add(first - 1, (first - begin) / size);
        for (int source = first; source < last; ++source) add(source, 1 / size);
        if (end - last > 1e-3) add(last, std::min({end - last, 1.0, size}) / size);
    }
    return all;
}

// The two pixels between whose centres the resized one lies.
std::vector<Mixture<int>> neighbours(int from, int to, bool is_row) {
    const double step = static_cast<double>(from) / to;
    std::vector<Mixture<int>> all(to);
    for (int i = 0; i < to; ++i) {
        const auto at = static_cast<float>((i + 0.5) * step - 0.5);
        int first = static_cast<int>(std::floor(at));
        float rest = at - static_cast<float>(first);
        if (!is_row && (first < 0 || first >= from - 1)) {
            first = first < 0 ? 0 : from - 1;
            rest = 0;
        }
        for (const int source : {first, first + 1})
            all[i].sources.push_back(std::clamp(source, 0, from - 1));
        for (const float weight : {1 - rest, rest})
            all[i].weights.push_back(static_cast<int>(std::nearbyint(weight * one)));
    }
    return all;
}

template <typename Weight>
void mix_row(const std::uint8_t* bytes, int channels, const std::vector<Mixture<Weight>>& columns,
             std::vector<Weight>& line) {
    std::size_t i = 0;
    for (const Mixture<Weight>& column : columns) {
        for (int c = 0; c < channels; ++c, ++i) {
            Weight sum = 0;
            for (std::size_t k = 0; k < column.weights.size(); ++k)
                sum += column.weights[k] * bytes[column.sources[k] * channels + c];
            line[i] = sum;
        }
    }
}

}  // namespace

void resize(const RowOf& row_of, Size from, Size to, int channels, std::uint8_t* out,
            std::size_t stride) {
    const std::size_t count = static_cast<std::size_t>(to.width) * channels;
    if (to.width < from.width) {
        // Halves become even numbers, or go up where the frame is halved both ways.
        const bool is_half = 2 * to.width == from.width && 2 * to.height == from.height;
        const auto columns = areas(from.width, to.width);
        std::vector<float> line(count), sums(count);
        int mixed = -1;  // the source row in `line`: neighbours share one
        for (const Mixture<float>& row : areas(from.height, to.height)) {
            std::fill(sums.begin(), sums.end(), 0.0f);
            for (std::size_t k = 0; k < row.weights.size(); ++k) {
                if (row.sources[k] != mixed)
                    mix_row(row_of(mixed = row.sources[k]), channels, columns, line);
                for (std::size_t i = 0; i < count; ++i) sums[i] += row.weights[k] * line[i];
            }
            for (std::size_t i = 0; i < count; ++i)
                out[i] = static_cast<std::uint8_t>(is_half ? sums[i] + 0.5f
                                                           : std::nearbyint(sums[i]));
            out += stride;
        }
        return;
    }
    const auto columns = neighbours(from.width, to.width, false);
    std::vector<int> lines[] = {std::vector<int>(count), std::vector<int>(count)};
    for (const Mixture<int>& row : neighbours(from.height, to.height, true)) {
        for (int k : {0, 1}) mix_row(row_of(row.sources[k]), channels, columns, lines[k]);
        const auto part = [&](int k, std::size_t i) {
            return (row.weights[k] * (lines[k][i] >> 4)) >> 16;
        };
        for (std::size_t i = 0; i < count; ++i)
            out[i] = static_cast<std::uint8_t>((part(0, i) + part(1, i) + 2) >> 2);
        out += stride;
    }
}
