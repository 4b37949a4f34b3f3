#include "network.hpp"

#include <openvino/openvino.hpp>

struct Network::Session {
    Manifest manifest;
    ov::InferRequest request;
};

Network::Network(const std::string& model, const Manifest& manifest, int threads) {
    ov::Core core;
    // OpenVINO rounds float32 networks to bfloat16 where the processor can, unless it is told not
    // to: boxes then differ by pixels.
    auto compiled = core.compile_model(
        model, "CPU", ov::hint::inference_precision(ov::element::f32),
        ov::hint::performance_mode(ov::hint::PerformanceMode::LATENCY),
        ov::inference_num_threads(threads));
    session_ = std::make_unique<Session>(Session{manifest, compiled.create_infer_request()});
}

Network::~Network() = default;

Outputs Network::run(std::vector<std::vector<std::uint8_t>>& inputs) {
    const Manifest& manifest = session_->manifest;
    ov::InferRequest& request = session_->request;
    for (std::size_t i = 0; i < manifest.inputs.size(); ++i) {
        const Input& input = manifest.inputs[i];
        ov::Shape shape{1, static_cast<std::size_t>(manifest.height),
                        static_cast<std::size_t>(manifest.width)};
        if (input.channels == 3) shape.push_back(3);
        request.set_tensor(input.name, ov::Tensor(ov::element::u8, shape, inputs.at(i).data()));
    }
    request.infer();

    Outputs outputs;
    outputs.count = static_cast<int>(request.get_tensor("num_detections").data<std::int64_t>()[0]);
    const auto values = [&request](const std::string& name) {
        const ov::Tensor tensor = request.get_tensor(name);
        const float* data = tensor.data<float>();
        return std::vector<float>(data, data + tensor.get_size());
    };
    outputs.boxes = values("boxes");
    outputs.scores = values("scores");
    if (manifest.has_keypoints) {
        outputs.points = values("keypoints");
        outputs.keypoints = static_cast<int>(request.get_tensor("keypoints").get_shape()[2]);
    }
    if (manifest.has_masks) {
        outputs.masks = values("masks");
        outputs.mask_size = static_cast<int>(request.get_tensor("masks").get_shape()[2]);
    }
    return outputs;
}

std::string Network::runtime() { return "openvino"; }

std::string Network::version() {
    const std::string build = ov::get_openvino_version().buildNumber;
    return build.substr(0, build.find('-'));
}
