// Finds the trees of a conformance kit: run_kit KIT RESULTS.json [THREADS] [ROUNDS]

#include <algorithm>
#include <chrono>
#include <cstring>
#include <fstream>
#include <iomanip>
#include <iostream>
#include <iterator>
#include <stdexcept>

#include "json.hpp"
#include "manifest.hpp"
#include "network.hpp"
#include "prepare.hpp"
#include "reach.hpp"
#include "trees.hpp"

namespace {

std::string read_file(const std::string& path) {
    std::ifstream file(path, std::ios::binary);
    if (!file) throw std::runtime_error(path + " cannot be read");
    return {std::istreambuf_iterator<char>(file), {}};
}

// 16-bit numbers of a file, which are little-endian, as on x86 and arm.
std::vector<std::uint16_t> read_millimetres(const std::string& path) {
    const std::string bytes = read_file(path);
    std::vector<std::uint16_t> values(bytes.size() / 2);
    std::memcpy(values.data(), bytes.data(), values.size() * 2);
    return values;
}

// A frame of a kit: colour, depth, or both.
Frame read_frame(const std::string& kit, const Json& entry) {
    const std::string file = kit + "/" + entry.str("file");
    Frame frame{static_cast<int>(entry.num("width")), static_cast<int>(entry.num("height")), {}, {}, {}};
    if (entry.num("channels") == 3) {
        const std::string bytes = read_file(file);
        frame.bgr.assign(bytes.begin(), bytes.end());
    } else {
        frame.depth_mm = read_millimetres(file);
    }
    if (entry.has("depth_file") && entry.at("depth_file").kind == Json::Kind::text)
        frame.depth_mm = read_millimetres(kit + "/" + entry.str("depth_file"));
    frame.camera = camera_of(entry);
    return frame;
}

// `items` as a JSON list; `write` writes one of them.
template <typename Items, typename Write>
void list(std::ostream& out, const Items& items, Write write) {
    out << '[';
    const char* comma = "";
    for (const auto& item : items) {
        out << comma;
        write(item);
        comma = ",";
    }
    out << ']';
}

void write_tree(std::ostream& out, const Tree& tree) {
    const auto number = [&out](double value) { out << value; };
    out << "{\"score\":" << tree.score << ",\"box_px\":";
    list(out, tree.box, number);
    if (!tree.keypoints.empty()) {
        out << ",\"keypoints_px\":";
        list(out, tree.keypoints, [&](const auto& point) { list(out, point, number); });
    }
    if (!tree.mask.empty()) {
        out << ",\"mask\":";
        list(out, tree.mask, number);
    }
    out << '}';
}

double median(std::vector<double> values) {
    std::sort(values.begin(), values.end());
    const std::size_t half = values.size() / 2;
    return values.size() % 2 ? values[half] : (values[half - 1] + values[half]) / 2;
}

void run(const std::string& folder, const std::string& out_path, int threads, int rounds) {
    const Json kit = Json::parse(read_file(folder + "/kit.json"));
    const std::string model = folder + "/" + kit.str("model");
    const Manifest manifest = read_manifest(model);
    const Preparation preparation(manifest);
    Network network(model, manifest, threads);
    const auto detect = [&](const Frame& frame) {
        auto inputs = preparation.inputs_of(frame);
        const double threshold = kit.num("score_threshold");
        auto trees = trees_of(network.run(inputs), manifest, frame, threshold);
        return within_reach(std::move(trees), manifest, frame, threshold);
    };

    std::vector<std::pair<std::string, Frame>> frames;
    for (const Json& entry : kit.at("frames").list)
        frames.emplace_back(entry.str("name"), read_frame(folder, entry));
    std::ofstream out(out_path);
    out << std::fixed << std::setprecision(4);
    out << "{\"schema\":\"edgetree.conformance-results/1\",\"model_sha256\":\""
        << kit.str("model_sha256") << "\",\"host\":\"examples/hosts/cpp\",\"runtime\":\""
        << Network::runtime() << "\",\"runtime_version\":\"" << Network::version()
        << "\",\"processor\":\""
#if defined(__aarch64__) || defined(_M_ARM64)
        << "arm64"
#else
        << "x86-64"
#endif
        << "\",\"threads\":" << threads << ",\"frames\":";
    list(out, frames, [&](const auto& named) {
        out << "{\"name\":\"" << named.first << "\",\"trees\":";
        list(out, detect(named.second), [&](const Tree& tree) { write_tree(out, tree); });
        out << '}';
    });
    std::vector<double> times_ms;
    for (int round = 0; round < rounds; ++round)
        for (const auto& named : frames) {
            const auto begin = std::chrono::steady_clock::now();
            detect(named.second);
            const std::chrono::duration<double, std::milli> took =
                std::chrono::steady_clock::now() - begin;
            times_ms.push_back(took.count());
        }
    if (!times_ms.empty()) out << ",\"median_ms\":" << median(times_ms);
    out << "}\n";
    if (!out.flush()) throw std::runtime_error(out_path + " cannot be written");
}

}  // namespace

int main(int count, char** words) {
    if (count < 3) {
        std::cerr << "usage: run_kit KIT RESULTS.json [THREADS] [ROUNDS]\n";
        return 2;
    }
    try {
        run(words[1], words[2], count > 3 ? std::stoi(words[3]) : 2, count > 4 ? std::stoi(words[4]) : 0);
    } catch (const std::exception& error) {
        std::cerr << "run_kit: " << error.what() << '\n';
        return 2;
    }
    return 0;
}
