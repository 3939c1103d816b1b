// Replaces set numbers of a block, with the widest instructions of this processor.
#pragma once

#include <cstdint>

#include "semmap/family.hpp"
#include "semmap/fields/voxels.hpp"

#if defined(__x86_64__)
#include <immintrin.h>
#endif

namespace semmap::fields {

#define SEMMAP_FAMILY baseline
#define SEMMAP_TARGET
#define SEMMAP_LANES 1
#include "retag.inc"

#if defined(__x86_64__)
#define SEMMAP_FAMILY avx2
#define SEMMAP_TARGET __attribute__((target("avx2,bmi,popcnt")))
#define SEMMAP_LANES 8
#include "retag.inc"

#define SEMMAP_FAMILY avx512
#define SEMMAP_TARGET __attribute__((target("avx512f,avx512bw,avx512vl,avx512dq,bmi,popcnt")))
#define SEMMAP_LANES 16
#include "retag.inc"
#endif

template <typename Step>
void retag(Family family, std::int32_t* values, const Words& mask, Step& step) {
#if defined(__x86_64__)
    if (family == Family::avx512) return avx512::retag(values, mask, step);
    if (family == Family::avx2) return avx2::retag(values, mask, step);
#endif
    static_cast<void>(family);
    baseline::retag(values, mask, step);
}

}  // namespace semmap::fields
