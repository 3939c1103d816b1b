// Replaces set numbers of a block, with the widest instructions of this processor.
#pragma once

#include <cstdint>

#include "semmap/family.hpp"
#include "semmap/fields/voxels.hpp"

#if defined(__x86_64__)
#include <immintrin.h>
#endif

namespace semmap::fields {

#define SEMMAP_BODY "retag.inc"
#include "families.inc"

template <typename Step>
void retag(Family family, std::int32_t* values, const Words& mask, Step& step) {
    SEMMAP_CALL(family, retag(values, mask, step));
}

}  // namespace semmap::fields
