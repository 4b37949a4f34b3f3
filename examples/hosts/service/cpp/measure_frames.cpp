// Hands raw frames over to the service and prints the trees of each: measure_frames ADDRESS FRAMES
//
// FRAMES is what raw_frames.py writes, in place of a camera. Prints one JSON answer a line, and to
// stderr a line for people.

#include <cstdio>
#include <fstream>
#include <iostream>
#include <iterator>
#include <string>
#include <vector>

#include "edgetree_client.hpp"
#include "json.hpp"

namespace {

std::vector<char> bytes_of(const std::string& path) {
    std::ifstream file(path, std::ios::binary);
    if (!file) throw std::runtime_error("cannot read " + path);
    return {std::istreambuf_iterator<char>(file), {}};
}

void print_trees(const std::string& name, const std::string& answer) {
    const Json json = Json::parse(answer);
    if (json.str("schema") != "edgetree.serve.result/1") {
        std::fprintf(stderr, "%s: %s\n", name.c_str(), answer.c_str());
        return;
    }
    for (const Json& tree : json.at("result").at("trees").list) {
        const Json& metres = tree.at("metres");
        if (metres.kind != Json::Kind::object) continue;  // neither depth nor another way
        if (metres.has("diameter_m"))
            std::fprintf(stderr, "%s: tree %.0f, diameter %.3f +- %.3f m\n", name.c_str(),
                         tree.num("tree"), metres.num("diameter_m"), metres.num("diameter_std_m"));
        else
            std::fprintf(stderr, "%s: tree %.0f, no diameter: %s\n", name.c_str(),
                         tree.num("tree"), metres.str("diameter_failure").c_str());
    }
}

int run(const std::string& address, const std::string& folder) {
    std::ifstream list(folder + "/frames.txt");
    if (!list) throw std::runtime_error("cannot read " + folder + "/frames.txt");
    edgetree::Client client(address, 60000);
    std::cerr << "waiting for the service at " << address << "\n";
    std::string name;
    int count = 0;
    while (list >> name) {
        edgetree::Frame frame;
        edgetree::Camera camera{};
        std::array<double, 3> up{};
        edgetree::Pose pose{};
        list >> frame.time_s >> camera.width >> camera.height;
        list >> camera.fx >> camera.fy >> camera.cx >> camera.cy;
        for (double& value : up) list >> value;
        for (double& value : pose.rotation) list >> value;
        for (double& value : pose.translation_m) list >> value;
        const std::vector<char> colour = bytes_of(folder + "/" + name + ".bgr");
        const std::vector<char> depth = bytes_of(folder + "/" + name + ".depth");
        frame.colour = edgetree::Colour{colour.data(), camera.width, camera.height};
        frame.depth = edgetree::Depth{depth.data(), camera.width, camera.height, "float32", 1.0};
        frame.camera = camera;
        frame.up_camera = up;
        frame.pose = pose;
        const std::string answer = client.measure(frame);
        std::cout << answer << std::endl;
        print_trees(name, answer);
        ++count;
    }
    return count > 0 ? 0 : 1;
}

}  // namespace

int main(int argc, char** argv) {
    if (argc != 3) {
        std::cerr << "usage: measure_frames ADDRESS FRAMES\n";
        return 2;
    }
    try {
        return run(argv[1], argv[2]);
    } catch (const std::exception& error) {
        std::cerr << error.what() << "\n";
        return 1;
    }
}
