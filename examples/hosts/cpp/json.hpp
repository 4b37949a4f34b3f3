// Reads JSON: enough for manifests and kits.
#pragma once

#include <map>
#include <string>
#include <string_view>
#include <vector>

struct Json {
    enum class Kind { null, boolean, number, text, list, object };
    Kind kind = Kind::null;
    double number = 0;  // of a number, and 1 for true
    std::string text;
    std::vector<Json> list;
    std::map<std::string, Json> object;

    static Json parse(std::string_view text);
    bool has(const std::string& name) const { return object.count(name) > 0; }
    const Json& at(const std::string& name) const;  // throws std::runtime_error with the name
    double num(const std::string& name) const { return at(name).number; }
    const std::string& str(const std::string& name) const { return at(name).text; }
};
