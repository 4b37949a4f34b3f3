#include "prepare.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace {

// The source pixels that one resized pixel mixes, and their weights.
struct Mixture {
    int first;
    std::vector<float> weights;
};

std::vector<Mixture> mixtures(int from, int to, bool shrinking) {
    const double step = static_cast<double>(from) / to;
    std::vector<Mixture> all(to);
    for (int i = 0; i < to; ++i) {
        Mixture& mixture = all[i];
        if (shrinking) {  // mean of an area
            const double begin = i * step, end = std::min<double>(from, (i + 1) * step);
            mixture.first = static_cast<int>(begin);
            for (int source = mixture.first; source < end - 1e-9; ++source)
                mixture.weights.push_back(static_cast<float>(
                    (std::min<double>(end, source + 1) - std::max<double>(begin, source)) /
                    (end - begin)));
        } else {  // bilinear, between pixel centres
            const double at = std::clamp((i + 0.5) * step - 0.5, 0.0, from - 1.0);
            mixture.first = std::min(static_cast<int>(at), std::max(0, from - 2));
            const auto rest = static_cast<float>(at - mixture.first);
            if (from > 1) mixture.weights = {1 - rest, rest};
            else mixture.weights = {1};
        }
    }
    return all;
}

// Depth as 8-bit greys: a table over all millimetres.
std::vector<std::uint8_t> grey_table(const DepthEncoding& depth) {
    const double per_m = (depth.far_value - depth.near_value) / (depth.far_m - depth.near_m);
    const double offset = depth.near_value - depth.near_m * per_m;
    const auto [low, high] = std::minmax(depth.near_value, depth.far_value);
    std::vector<std::uint8_t> table(65536);
    for (int mm = 0; mm < 65536; ++mm) {
        const double grey = std::nearbyint(mm / 1000.0 * per_m + offset);  // half to even
        table[mm] = static_cast<std::uint8_t>(std::clamp<double>(grey, low, high));
    }
    table[0] = static_cast<std::uint8_t>(depth.invalid_value);
    return table;
}

}  // namespace

Letterbox fit(int width, int height, const Manifest& manifest) {
    const double scale = std::min(static_cast<double>(manifest.width) / width,
                                  static_cast<double>(manifest.height) / height);
    const auto side = [scale](int length, int most) {
        return std::min(most, std::max(1, static_cast<int>(std::nearbyint(length * scale))));
    };
    const int w = side(width, manifest.width), h = side(height, manifest.height);
    return {w, h, static_cast<double>(w) / width, static_cast<double>(h) / height};
}

Preparation::Preparation(const Manifest& manifest) : manifest_(manifest) {
    if (manifest.depth) grey_ = grey_table(*manifest.depth);
}

std::vector<std::vector<std::uint8_t>> Preparation::inputs_of(const Frame& frame) const {
    std::vector<std::vector<std::uint8_t>> all;
    for (const Input& input : manifest_.inputs) all.push_back(input_of(frame, input));
    return all;
}

std::vector<std::uint8_t> Preparation::input_of(const Frame& frame, const Input& input) const {
    const Manifest& manifest = manifest_;
    const int channels = input.channels, line_size = frame.width * channels;
    const bool is_depth = channels == 1;
    const std::size_t given = is_depth ? frame.depth_mm.size() : frame.bgr.size();
    const std::size_t size = static_cast<std::size_t>(manifest.width) * manifest.height * channels;
    if (given == 0 && input.nothing >= 0)
        return std::vector<std::uint8_t>(size, static_cast<std::uint8_t>(input.nothing));
    if (given != static_cast<std::size_t>(line_size) * frame.height)
        throw std::runtime_error("a frame has another size than its width and height say");
    const Letterbox box = fit(frame.width, frame.height, manifest);
    const bool shrinking = box.width < frame.width;
    const auto columns = mixtures(frame.width, box.width, shrinking);
    const auto rows = mixtures(frame.height, box.height, shrinking);

    std::vector<std::uint8_t> padded(size, static_cast<std::uint8_t>(input.pad_value));
    std::vector<float> line(line_size);
    std::vector<std::uint8_t> grey(line_size);
    for (int y = 0; y < box.height; ++y) {
        std::fill(line.begin(), line.end(), 0.0f);
        for (std::size_t k = 0; k < rows[y].weights.size(); ++k) {
            const std::size_t start = (rows[y].first + k) * static_cast<std::size_t>(line_size);
            const std::uint8_t* source = grey.data();
            if (is_depth) {
                for (int i = 0; i < line_size; ++i) grey[i] = grey_[frame.depth_mm[start + i]];
            } else {
                source = frame.bgr.data() + start;
            }
            const float weight = rows[y].weights[k];
            for (int i = 0; i < line_size; ++i) line[i] += weight * source[i];
        }
        std::uint8_t* out = padded.data() + static_cast<std::size_t>(y) * manifest.width * channels;
        for (const Mixture& column : columns) {
            for (int c = 0; c < channels; ++c) {
                float sum = 0.5f;  // for rounding to the nearest
                const float* source = line.data() + column.first * channels + c;
                for (const float weight : column.weights) {
                    sum += weight * *source;
                    source += channels;
                }
                *out++ = static_cast<std::uint8_t>(sum);
            }
        }
    }
    return padded;
}
