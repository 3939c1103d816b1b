// The same functions for the instructions of processor families; results are equal.
#pragma once

#include <stdexcept>
#include <string>
#include <vector>

namespace semmap {

enum class Family { baseline, avx2, avx512 };

constexpr const char* kFamilyNames[] = {"baseline", "avx2", "avx512"};

// Those that this processor runs, the slowest first.
inline std::vector<Family> families() {
    std::vector<Family> found{Family::baseline};
#if defined(__x86_64__)
    if (__builtin_cpu_supports("avx2")) found.push_back(Family::avx2);
    if (__builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512bw") &&
        __builtin_cpu_supports("avx512vl") && __builtin_cpu_supports("avx512dq")) {
        found.push_back(Family::avx512);
    }
#endif
    return found;
}

inline std::vector<std::string> family_names() {
    std::vector<std::string> names;
    for (const Family each : families()) names.emplace_back(kFamilyNames[static_cast<int>(each)]);
    return names;
}

inline Family family_named(const std::string& name) {
    for (const Family each : families()) {
        if (name == kFamilyNames[static_cast<int>(each)]) return each;
    }
    throw std::invalid_argument("this processor has no variant " + name);
}

// Calls a function that native/src/families.inc has made once a family.
#if defined(__x86_64__)
#define SEMMAP_CALL(family, ...)                              \
    ((family) == semmap::Family::avx512 ? avx512::__VA_ARGS__ \
     : (family) == semmap::Family::avx2 ? avx2::__VA_ARGS__   \
                                        : baseline::__VA_ARGS__)
#else
#define SEMMAP_CALL(family, ...) (static_cast<void>(family), baseline::__VA_ARGS__)
#endif

}  // namespace semmap
