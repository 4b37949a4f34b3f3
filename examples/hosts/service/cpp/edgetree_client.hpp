// Hands frames over to `edgetree live clients --serve ADDRESS` and gets metres. Linux; links libzmq.
//
//   edgetree::Client client("tcp://127.0.0.1:8430");
//   std::string answer = client.measure(frame);  // JSON, see messages.schema.json
//
// Pixels go through shared memory, or with the messages where the service cannot read the memory, as
// that of another user. One client is for one thread.
#pragma once

#include <fcntl.h>
#include <sys/mman.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <chrono>
#include <cstdint>
#include <cstring>
#include <limits>
#include <locale>
#include <optional>
#include <sstream>
#include <stdexcept>
#include <string>
#include <vector>

#if __has_include(<zmq.h>)
#include <zmq.h>
#else  // what is used of libzmq's binary interface, for machines that have the library alone
extern "C" {
void* zmq_ctx_new(void);
int zmq_ctx_term(void*);
void* zmq_socket(void*, int);
int zmq_setsockopt(void*, int, const void*, size_t);
int zmq_connect(void*, const char*);
int zmq_send(void*, const void*, size_t, int);
int zmq_recv(void*, void*, size_t, int);
int zmq_close(void*);
}
constexpr int ZMQ_SNDMORE = 2, ZMQ_DEALER = 5, ZMQ_LINGER = 17;
constexpr int ZMQ_RCVTIMEO = 27, ZMQ_SNDTIMEO = 28;
#endif

namespace edgetree {

// Pixels row by row, without gaps.
struct Colour {
    const void* pixels;
    int width, height;
    std::string format = "bgr8";  // or rgb8, bgra8, rgba8, mono8
};

// Aligned with the colour image; 0 is no reading.
struct Depth {
    const void* pixels;
    int width, height;
    std::string format = "uint16";  // or float32
    double scale_m = 0.001;         // metres per unit
};

struct Camera {
    int width, height;
    double fx, fy, cx, cy;
    std::vector<double> distortion;  // in OpenCV's order
};

// From the camera's frame (x right, y down, z forward) to a fixed one with z up.
struct Pose {
    std::array<double, 9> rotation;  // row by row
    std::array<double, 3> translation_m;
};

struct Frame {
    double time_s = 0;
    std::optional<Colour> colour;
    std::optional<Depth> depth;
    std::optional<Camera> camera;
    std::optional<std::array<double, 3>> up_camera;  // away from gravity, in the camera's frame
    std::optional<Pose> pose;
};

class Client {
public:
    explicit Client(const std::string& address, int timeout_ms = 10000)
        : address_(address), timeout_(timeout_ms) {
        const int linger_ms = 500;
        zmq_setsockopt(socket_, ZMQ_LINGER, &linger_ms, sizeof linger_ms);
        zmq_setsockopt(socket_, ZMQ_RCVTIMEO, &timeout_ms, sizeof timeout_ms);
        zmq_setsockopt(socket_, ZMQ_SNDTIMEO, &timeout_ms, sizeof timeout_ms);
        if (zmq_connect(socket_, address.c_str()) != 0) fail("is no address");
    }

    ~Client() {
        send("{\"schema\":\"edgetree.serve.bye/1\"}", false);
        zmq_close(socket_);
        zmq_ctx_term(context_);
        release();
    }

    Client(const Client&) = delete;
    Client& operator=(const Client&) = delete;

    // Hands a frame over and waits for its answer: a result, "unused" or an error, as JSON.
    std::string measure(const Frame& frame) {
        std::string answer = ask(frame);
        for (int again = 0; again < 2; ++again) {
            if (answer.find("\"error\":\"shared memory ") == std::string::npos) break;
            release();  // the service has begun anew and does not know it, or is of another user
            uses_memory_ = again == 0;
            answer = ask(frame);
        }
        return answer;
    }

    // Asks for all results from now on, which `receive` returns.
    void watch() { send("{\"schema\":\"edgetree.serve.watch/1\"}"); }

    // The next answer, of whatever frame.
    std::string receive() {
        const int size =
            waiting([this] { return zmq_recv(socket_, buffer_.data(), buffer_.size(), 0); });
        if (size < 0) fail("does not answer");
        if (size_t(size) > buffer_.size()) fail("sends more than 4 MiB");
        return {buffer_.data(), size_t(size)};
    }

private:
    std::string ask(const Frame& frame) {
        const uint64_t id = ++last_id_;
        const size_t colour_bytes = frame.colour ? bytes(*frame.colour) : 0;
        const size_t depth_bytes = frame.depth ? bytes(*frame.depth) : 0;
        if (uses_memory_) {
            reserve(colour_bytes + depth_bytes);
            if (frame.colour) std::memcpy(memory_, frame.colour->pixels, colour_bytes);
            if (frame.depth) std::memcpy(memory_ + colour_bytes, frame.depth->pixels, depth_bytes);
            send(text(frame, id, colour_bytes));
        } else {
            const std::string about = text(frame, id, 0);
            part(about.data(), about.size(), colour_bytes + depth_bytes != 0);
            if (frame.colour) part(frame.colour->pixels, colour_bytes, depth_bytes != 0);
            if (frame.depth) part(frame.depth->pixels, depth_bytes, false);
        }
        const std::string mine = "\"id\":" + std::to_string(id) + ",";
        try {
            while (true) {  // late answers to earlier frames, and watched results, are passed over
                std::string answer = receive();
                const std::string head = answer.substr(0, 80);
                const bool is_unread = head.find("serve.error/") != std::string::npos &&
                                       head.find("\"id\":null") != std::string::npos;
                if (is_unread || head.find(mine) != std::string::npos) return answer;
            }
        } catch (...) {
            release();  // which the service may still read for this frame
            throw;
        }
    }

    // Calls of libzmq end early if the program handles a signal, and begin their time again. So a wait
    // takes twice the timeout at most; a negative timeout is no end.
    template <typename Call>
    int waiting(Call call) const {
        const auto begin = std::chrono::steady_clock::now();
        const auto has_time = [&] {
            return timeout_.count() < 0 || std::chrono::steady_clock::now() - begin < timeout_;
        };
        int result = call();
        while (result < 0 && errno == EINTR && has_time()) result = call();
        return result;
    }

    template <typename Image>
    static size_t bytes(const Image& image) {
        const std::string& name = image.format;
        const size_t each = name == "mono8" ? 1 : name == "uint16" ? 2 : name.size() == 4 ? 3 : 4;
        return each * image.width * image.height;
    }

    std::string text(const Frame& frame, uint64_t id, size_t depth_offset) const {
        std::ostringstream out;
        out.imbue(std::locale::classic());  // JSON, whatever the program's locale
        out.precision(std::numeric_limits<double>::max_digits10);
        out << "{\"schema\":\"edgetree.serve.frame/1\",\"id\":" << id;
        out << ",\"time_s\":" << frame.time_s;
        if (frame.colour) image(out, "colour", *frame.colour, 0) << "}";
        if (frame.depth) {
            image(out, "depth", *frame.depth, depth_offset);
            out << ",\"scale_m\":" << frame.depth->scale_m << "}";
        }
        if (const auto& camera = frame.camera) {
            out << ",\"camera\":{\"width\":" << camera->width << ",\"height\":" << camera->height;
            out << ",\"fx\":" << camera->fx << ",\"fy\":" << camera->fy << ",\"cx\":" << camera->cx;
            out << ",\"cy\":" << camera->cy << ",\"distortion\":";
            numbers(out, camera->distortion) << "}";
        }
        if (frame.up_camera) numbers(out << ",\"up_camera\":", *frame.up_camera);
        if (frame.pose) {
            const double* r = frame.pose->rotation.data();
            out << ",\"pose\":{\"rotation\":[";
            for (int row = 0; row < 3; ++row)
                numbers(out << (row ? "," : ""), std::array{r[3 * row], r[3 * row + 1], r[3 * row + 2]});
            numbers(out << "],\"translation_m\":", frame.pose->translation_m) << "}";
        }
        out << "}";
        return out.str();
    }

    template <typename Image>
    std::ostream& image(std::ostream& out, const char* name, const Image& image, size_t at) const {
        out << ",\"" << name << "\":{\"width\":" << image.width << ",\"height\":" << image.height;
        out << ",\"format\":\"" << image.format << "\"";
        if (!uses_memory_) return out;
        return out << ",\"memory\":{\"name\":\"" << memory_name_ << "\",\"offset\":" << at << "}";
    }

    template <typename Values>
    static std::ostream& numbers(std::ostream& out, const Values& values) {
        const char* before = "[";
        for (const double value : values) out << before << value, before = ",";
        return out << (values.size() ? "]" : "[]");
    }

    void send(const std::string& text, bool must = true) {
        const auto sent = waiting([&] { return zmq_send(socket_, text.data(), text.size(), 0); });
        if (sent < 0 && must) fail("takes no messages");
    }

    void part(const void* bytes, size_t size, bool more) {
        const int flags = more ? ZMQ_SNDMORE : 0;
        if (waiting([&] { return zmq_send(socket_, bytes, size, flags); }) < 0)
            fail("takes no messages");
    }

    void reserve(size_t size) {
        if (size <= memory_size_) return;
        release();
        const auto now = std::chrono::steady_clock::now().time_since_epoch().count();
        memory_name_ = "/edgetree-" + std::to_string(getpid()) + "-" + std::to_string(now);
        const int file = shm_open(memory_name_.c_str(), O_RDWR | O_CREAT | O_EXCL, 0600);
        if (file < 0) throw std::runtime_error("there is no shared memory");
        const bool is_there = posix_fallocate(file, 0, off_t(size)) == 0;
        void* memory = mmap(nullptr, size, PROT_READ | PROT_WRITE, MAP_SHARED, file, 0);
        close(file);
        if (!is_there || memory == MAP_FAILED) {
            shm_unlink(memory_name_.c_str());
            throw std::runtime_error("there is not enough shared memory");
        }
        memory_ = static_cast<char*>(memory);
        memory_size_ = size;
    }

    void release() {
        if (!memory_) return;
        munmap(memory_, memory_size_);
        shm_unlink(memory_name_.c_str());  // of which the service has removed the name, if it read it
        memory_ = nullptr;
        memory_size_ = 0;
    }

    [[noreturn]] void fail(const char* how) const {
        throw std::runtime_error("the service at " + address_ + " " + how);
    }

    std::string address_;
    std::chrono::milliseconds timeout_;
    void* context_ = zmq_ctx_new();
    void* socket_ = zmq_socket(context_, ZMQ_DEALER);
    std::vector<char> buffer_ = std::vector<char>(4 << 20);
    std::string memory_name_;
    char* memory_ = nullptr;
    size_t memory_size_ = 0;
    bool uses_memory_ = true;
    uint64_t last_id_ = 0;
};

}  // namespace edgetree
