#include "manifest.hpp"

#include <cstdint>
#include <fstream>
#include <sstream>
#include <stdexcept>

#include "json.hpp"

namespace {

constexpr int kMetadata = 14;  // the field of an ONNX file with pairs of a key and a value

// One field of a protobuf message: its number, and its bytes if it is a text or a message.
struct Field {
    std::uint64_t number;
    std::string bytes;
};

std::uint64_t varint(std::istream& stream) {
    std::uint64_t value = 0;
    for (int shift = 0; shift < 64; shift += 7) {
        const int byte = stream.get();
        if (byte < 0) throw std::runtime_error("not an ONNX file: it ends within a field");
        value |= static_cast<std::uint64_t>(byte & 127) << shift;
        if (byte < 128) return value;
    }
    throw std::runtime_error("not an ONNX file: a number is too long");
}

// The next field; the bytes of fields other than `wanted` are skipped, as the graph with the weights.
std::optional<Field> next(std::istream& stream, std::uint64_t wanted = 0) {
    if (stream.peek() < 0) return std::nullopt;
    const std::uint64_t tag = varint(stream);
    Field field{tag / 8, ""};
    switch (tag % 8) {
        case 0: varint(stream); break;
        case 1: stream.ignore(8); break;
        case 5: stream.ignore(4); break;
        case 2: {
            const std::uint64_t length = varint(stream);
            if (wanted != 0 && field.number != wanted) {
                stream.seekg(static_cast<std::streamoff>(length), std::ios::cur);
                break;
            }
            if (length > (1u << 24)) throw std::runtime_error("not an ONNX file: a text is too long");
            field.bytes.resize(length);
            stream.read(field.bytes.data(), static_cast<std::streamsize>(length));
            break;
        }
        default: throw std::runtime_error("not an ONNX file: a field has an unknown type");
    }
    return field;
}

std::string manifest_text(const std::string& path) {
    std::ifstream file(path, std::ios::binary);
    if (!file) throw std::runtime_error(path + " cannot be read");
    while (const auto field = next(file, kMetadata)) {
        if (field->number != kMetadata) continue;
        std::istringstream entry(field->bytes);
        const auto key = next(entry), value = next(entry);
        if (key && value && key->bytes == "edgetree.manifest") return value->bytes;
    }
    throw std::runtime_error(path + " has no manifest: expected a model of `edgetree export`");
}

std::optional<double> reach_of(const Json& manifest) {
    const bool is_known =
        manifest.has("reach_m") && manifest.at("reach_m").kind == Json::Kind::number;
    return is_known ? std::optional(manifest.num("reach_m")) : std::nullopt;
}

}  // namespace

Manifest read_manifest(const std::string& model) {
    const Json json = Json::parse(manifest_text(model));
    if (json.str("schema") != "edgetree.manifest/1")
        throw std::runtime_error(model + ": the manifest has the schema " + json.str("schema") +
                                 ": expected edgetree.manifest/1");
    const Json &input = json.at("input"), &thresholds = json.at("thresholds");
    Manifest manifest{};
    const auto channels = [](const Json& one) { return one.str("layout") == "BHWC" ? 3 : 1; };
    if (json.has("inputs"))
        for (const Json& one : json.at("inputs").list)
            manifest.inputs.push_back({one.str("name"), channels(one),
                                       static_cast<int>(one.num("pad_value")),
                                       static_cast<int>(one.num("nothing"))});
    if (manifest.inputs.empty())
        manifest.inputs.push_back({input.str("name"), channels(input),
                                   static_cast<int>(json.at("resize").num("pad_value"))});
    manifest.width = static_cast<int>(input.num("width"));
    manifest.height = static_cast<int>(input.num("height"));
    // Older files do not say it.
    manifest.mask_overlap = thresholds.has("mask_overlap") ? thresholds.num("mask_overlap") : 0.8;
    if (const Json& depth = json.at("depth_encoding"); depth.kind == Json::Kind::object)
        manifest.depth = DepthEncoding{depth.num("near_m"), depth.num("far_m"),
                                       static_cast<int>(depth.num("near_value")),
                                       static_cast<int>(depth.num("far_value")),
                                       static_cast<int>(depth.num("invalid_value"))};
    manifest.reach_m = manifest.depth_reach_m = reach_of(json);
    if (json.has("alone") && json.at("alone").has("depth"))
        manifest.depth_reach_m = reach_of(json.at("alone").at("depth"));
    for (const Json& output : json.at("outputs").list) {
        manifest.has_keypoints |= output.str("name") == "keypoints";
        manifest.has_masks |= output.str("name") == "masks";
    }
    return manifest;
}
