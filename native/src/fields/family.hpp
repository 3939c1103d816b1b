// Which instructions this processor has.
#pragma once

namespace semmap::fields {

enum class Family { baseline, avx2, avx512 };

inline Family best_family() {
#if defined(__x86_64__)
    static const Family best = [] {
        if (__builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512bw") &&
            __builtin_cpu_supports("avx512vl") && __builtin_cpu_supports("avx512dq")) {
            return Family::avx512;
        }
        return __builtin_cpu_supports("avx2") ? Family::avx2 : Family::baseline;
    }();
    return best;
#else
    return Family::baseline;
#endif
}

}  // namespace semmap::fields
