// What the C++ host does before and after the network: parts KIT OUTPUTS OUT
//
// OUTPUTS/NAME.json holds the network's outputs for a frame of the kit.

#include <cstring>
#include <fstream>
#include <iterator>

#include "json.hpp"
#include "manifest.hpp"
#include "prepare.hpp"
#include "reach.hpp"
#include "trees.hpp"

static std::string read_file(const std::string& path) {
    std::ifstream file(path, std::ios::binary);
    return {std::istreambuf_iterator<char>(file), {}};
}

static std::vector<float> values(const Json& outputs, const std::string& name) {
    std::vector<float> all;
    for (const Json& value : outputs.at(name).at("values").list)
        all.push_back(static_cast<float>(value.number));
    return all;
}

int main(int, char** words) {
    const std::string folder = words[1], given = words[2], out = words[3];
    const Json kit = Json::parse(read_file(folder + "/kit.json"));
    const Manifest manifest = read_manifest(folder + "/" + kit.str("model"));
    std::ofstream file(out + "/trees.json");
    const char* comma = "{";
    for (const Json& entry : kit.at("frames").list) {
        const std::string name = entry.str("name");
        Frame frame{static_cast<int>(entry.num("width")), static_cast<int>(entry.num("height")), {}, {}, camera_of(entry)};
        const auto millimetres = [&frame](const std::string& bytes) {
            frame.depth_mm.resize(bytes.size() / 2);
            std::memcpy(frame.depth_mm.data(), bytes.data(), bytes.size());
        };
        const std::string bytes = read_file(folder + "/" + entry.str("file"));
        if (entry.num("channels") == 3) frame.bgr.assign(bytes.begin(), bytes.end());
        else millimetres(bytes);
        if (entry.at("depth_file").kind == Json::Kind::text)
            millimetres(read_file(folder + "/" + entry.str("depth_file")));
        const auto inputs = Preparation(manifest).inputs_of(frame);
        for (std::size_t i = 0; i < inputs.size(); ++i)
            std::ofstream(out + "/" + name + "." + manifest.inputs[i].name + ".raw", std::ios::binary)
                .write(reinterpret_cast<const char*>(inputs[i].data()), inputs[i].size());

        const Json json = Json::parse(read_file(given + "/" + name + ".json"));
        Outputs outputs;
        outputs.count = static_cast<int>(values(json, "num_detections").at(0));
        outputs.boxes = values(json, "boxes");
        outputs.scores = values(json, "scores");
        outputs.points = values(json, "keypoints");
        outputs.masks = values(json, "masks");
        outputs.keypoints = static_cast<int>(json.at("keypoints").at("shape").list[2].number);
        outputs.mask_size = static_cast<int>(json.at("masks").at("shape").list[2].number);
        file << comma << '"' << name << "\":[";
        const char* between = "";
        const double threshold = kit.num("score_threshold");
        auto found = trees_of(outputs, manifest, frame, threshold);
        for (const Tree& tree : within_reach(std::move(found), manifest, frame, threshold)) {
            file << between << "{\"score\":" << tree.score << ",\"box_px\":[" << tree.box[0] << ','
                 << tree.box[1] << ',' << tree.box[2] << ',' << tree.box[3] << "],\"keypoints_px\":[";
            const char* after = "";
            for (const auto& point : tree.keypoints) {
                file << after << '[' << point[0] << ',' << point[1] << ',' << point[2] << ']';
                after = ",";
            }
            file << "]}";
            between = ",";
        }
        file << ']';
        comma = ",";
    }
    file << '}';
}
