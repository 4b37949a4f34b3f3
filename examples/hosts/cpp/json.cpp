#include "json.hpp"

#include <cctype>
#include <charconv>
#include <stdexcept>

namespace {

class Reader {
public:
    explicit Reader(std::string_view text) : text_(text) {}

    Json value() {
        Json json;
        const char next = peek();
        if (next == '{') {
            json.kind = Json::Kind::object;
            items('{', '}', [&] {
                std::string name = string();
                expect(':');
                json.object.insert_or_assign(std::move(name), value());
            });
        } else if (next == '[') {
            json.kind = Json::Kind::list;
            items('[', ']', [&] { json.list.push_back(value()); });
        } else if (next == '"') {
            json.kind = Json::Kind::text;
            json.text = string();
        } else if (word("true") || word("false")) {
            json.kind = Json::Kind::boolean;
            json.number = text_[at_ - 2] == 'u';  // tr-u-e, fal-s-e
        } else if (!word("null")) {
            json.kind = Json::Kind::number;
            const char* begin = text_.data() + at_;
            const auto [end, error] = std::from_chars(begin, text_.data() + text_.size(), json.number);
            if (error != std::errc()) fail();
            at_ += end - begin;
        }
        return json;
    }

    void end() {
        space();
        if (at_ != text_.size()) fail();
    }

private:
    [[noreturn]] void fail() const {
        throw std::runtime_error("not JSON at character " + std::to_string(at_));
    }
    void space() {
        while (at_ < text_.size() && std::isspace(static_cast<unsigned char>(text_[at_]))) ++at_;
    }
    char peek() {
        space();
        if (at_ == text_.size()) fail();
        return text_[at_];
    }
    void expect(char wanted) {
        if (peek() != wanted) fail();
        ++at_;
    }
    bool word(std::string_view wanted) {
        if (text_.substr(at_, wanted.size()) != wanted) return false;
        at_ += wanted.size();
        return true;
    }
    template <typename Item>
    void items(char open, char close, Item item) {
        if (++depth_ > 100) fail();
        expect(open);
        while (peek() != close) {
            item();
            if (peek() != close) expect(',');
        }
        expect(close);
        --depth_;
    }
    std::string string() {
        expect('"');
        std::string result;
        while (at_ < text_.size() && text_[at_] != '"') {
            if (text_[at_] == '\\') {
                ++at_;
                result += escaped();
            } else {
                result += text_[at_++];
            }
        }
        expect('"');
        return result;
    }
    std::string escaped() {
        if (at_ == text_.size()) fail();
        const char kind = text_[at_++];
        if (kind != 'u') {
            const std::string_view from = "bfnrt", to = "\b\f\n\r\t";
            const auto place = from.find(kind);
            return std::string(1, place == from.npos ? kind : to[place]);
        }
        unsigned code = 0;
        const std::string_view digits = text_.substr(at_, 4);
        const auto end = digits.data() + digits.size();
        if (digits.size() < 4 || std::from_chars(digits.data(), end, code, 16).ptr != end) fail();
        at_ += 4;
        if (code < 0x80) return std::string(1, static_cast<char>(code));
        const char last = static_cast<char>(0x80 | (code & 63));
        if (code < 0x800) return {static_cast<char>(0xC0 | code >> 6), last};
        return {static_cast<char>(0xE0 | code >> 12), static_cast<char>(0x80 | (code >> 6 & 63)), last};
    }

    std::string_view text_;
    std::size_t at_ = 0;
    int depth_ = 0;
};

}  // namespace

Json Json::parse(std::string_view text) {
    Reader reader(text);
    Json json = reader.value();
    reader.end();
    return json;
}

const Json& Json::at(const std::string& name) const {
    const auto found = object.find(name);
    if (found == object.end()) throw std::runtime_error("no value " + name);
    return found->second;
}
