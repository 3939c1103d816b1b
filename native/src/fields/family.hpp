// Variants of functions for the instructions of processors.
#pragma once

#include <atomic>
#include <stdexcept>
#include <string>
#include <vector>

namespace semmap::fields {

enum class Family { baseline, avx2, avx512 };

constexpr const char* kFamilyNames[] = {"baseline", "avx2", "avx512"};

inline bool runs(Family family) {
#if defined(__x86_64__)
    if (family == Family::avx512) {
        return __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512bw") &&
               __builtin_cpu_supports("avx512vl") && __builtin_cpu_supports("avx512dq");
    }
    if (family == Family::avx2) return __builtin_cpu_supports("avx2") != 0;
#endif
    return family == Family::baseline;
}

inline std::atomic<Family>& chosen_family() {
    static std::atomic<Family> chosen{runs(Family::avx512) ? Family::avx512
                                      : runs(Family::avx2) ? Family::avx2
                                                           : Family::baseline};
    return chosen;
}

inline Family used_family() { return chosen_family().load(std::memory_order_relaxed); }

// The slowest first.
inline std::vector<std::string> family_names() {
    std::vector<std::string> names;
    for (const Family family : {Family::baseline, Family::avx2, Family::avx512}) {
        if (runs(family)) names.emplace_back(kFamilyNames[static_cast<int>(family)]);
    }
    return names;
}

inline void choose_family(const std::string& name) {
    for (const Family family : {Family::baseline, Family::avx2, Family::avx512}) {
        if (name == kFamilyNames[static_cast<int>(family)] && runs(family)) {
            chosen_family() = family;
            return;
        }
    }
    throw std::invalid_argument("this processor has no variant " + name);
}

}  // namespace semmap::fields
