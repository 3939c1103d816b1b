// Elementary slabs: the heights between neighbouring ends of intervals, each with the intervals
// that contain it, so that all intervals are taken in one pass.
#pragma once

#include <algorithm>
#include <cstdint>
#include <vector>

#include "semmap/occupancy.hpp"

namespace semmap {

using Mask = std::uint32_t;  // a bit an interval
static_assert(kMostIntervals <= 32);

// A height's place among the planes z = end of an interval, in ascending order: 2 i + 1 in plane i,
// even between planes.
using Place = std::uint8_t;

struct Slab {
    double low;
    double high;
    Place low_place;
    Place high_place;
    Mask intervals;
};

// The lower end of some intervals, where closed surfaces are cut to fill them.
struct FillPlane {
    double height;
    Place place;
    Place reach;  // the lowest upper end of these intervals
    Mask intervals;
};

struct Slabs {
    std::vector<double> planes;
    std::vector<Slab> slabs;  // ascending
    std::vector<FillPlane> fills;
    std::vector<std::uint8_t> first_from;  // by place: the first slab that reaches up to it
    Place top;                             // above all planes

    explicit Slabs(const std::vector<Interval>& intervals) {
        for (const Interval& interval : intervals) {
            planes.push_back(interval.low);
            planes.push_back(interval.high);
        }
        std::sort(planes.begin(), planes.end());
        planes.erase(std::unique(planes.begin(), planes.end()), planes.end());
        top = static_cast<Place>(2 * planes.size());
        for (std::size_t i = 0; i < planes.size(); ++i) {
            add(intervals, i, i);
            if (i + 1 < planes.size()) add(intervals, i, i + 1);
            Mask starts = 0;
            Place reach = top;
            for (std::size_t k = 0; k < intervals.size(); ++k) {
                if (intervals[k].low != planes[i]) continue;
                starts |= Mask{1} << k;
                reach = std::min(reach, place(intervals[k].high));
            }
            if (starts != 0) fills.push_back({planes[i], place_of(i), reach, starts});
        }
        for (int place = 0; place <= top; ++place) {
            std::size_t first = 0;
            while (first < slabs.size() && slabs[first].high_place < place) ++first;
            first_from.push_back(static_cast<std::uint8_t>(first));
        }
    }

    Place place(double height) const {
        if (height < planes.front()) return 0;
        if (height > planes.back()) return top;
        const auto at = std::lower_bound(planes.begin(), planes.end(), height);
        const auto i = static_cast<std::size_t>(at - planes.begin());
        return static_cast<Place>(*at == height ? place_of(i) : 2 * i);
    }

  private:
    static Place place_of(std::size_t plane) { return static_cast<Place>(2 * plane + 1); }

    // The slab between two planes, if an interval contains it; a single plane only for intervals
    // of zero height.
    void add(const std::vector<Interval>& intervals, std::size_t i, std::size_t j) {
        Mask mask = 0;
        for (std::size_t k = 0; k < intervals.size(); ++k) {
            const bool flat = intervals[k].low == intervals[k].high;
            if (flat == (i == j) && intervals[k].low <= planes[i] &&
                planes[j] <= intervals[k].high) {
                mask |= Mask{1} << k;
            }
        }
        if (mask != 0) slabs.push_back({planes[i], planes[j], place_of(i), place_of(j), mask});
    }
};

}  // namespace semmap
