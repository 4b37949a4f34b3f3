#include "prepare.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "resize.hpp"

namespace {

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
    if (frame.bgr.empty() && frame.depth_mm.empty())
        throw std::runtime_error("a frame has no image: expected colour or depth");
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
    std::vector<std::uint8_t> padded(size, static_cast<std::uint8_t>(input.pad_value));
    std::vector<std::uint8_t> grey(line_size);
    const auto row_of = [&](int y) -> const std::uint8_t* {
        const std::size_t start = y * static_cast<std::size_t>(line_size);
        if (!is_depth) return frame.bgr.data() + start;
        for (int i = 0; i < line_size; ++i) grey[i] = grey_[frame.depth_mm[start + i]];
        return grey.data();
    };
    resize(row_of, {frame.width, frame.height}, {box.width, box.height}, channels, padded.data(),
           static_cast<std::size_t>(manifest.width) * channels);
    return padded;
}
