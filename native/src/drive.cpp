#include "semmap/drive.hpp"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <limits>

#include "team.hpp"

namespace semmap {
namespace {

constexpr double kNowhere = std::numeric_limits<double>::infinity();
constexpr std::size_t kMargin = 2;  // how far a step leads, in rows or columns
constexpr unsigned kAll = 0xffff;
constexpr std::uint32_t kNone = 0xffffffff;
constexpr double kLongest = 2.2360679774997898;

struct Move {
    int rows;
    int columns;
};

constexpr Move kMoves[16] = {
    {0, 1},  {1, 2},   {1, 1},   {2, 1},   {1, 0},  {2, -1}, {1, -1}, {1, -2},
    {0, -1}, {-1, -2}, {-1, -1}, {-2, -1}, {-1, 0}, {-2, 1}, {-1, 1}, {-1, 2},
};

// The states: at a cell, the headings among which the shape can turn. Most cells have one.
struct States {
    explicit States(const Space& space)
        : stride(space.terrain.columns + 2 * kMargin),
          cells(stride * (space.terrain.rows + 2 * kMargin)),
          dearest(1.0 + space.terrain.slow),
          first(cells + 1),
          steps(cells, 0),
          worth(cells, kNowhere) {
        const Terrain& terrain = space.terrain;
        std::vector<std::uint8_t> open(cells, 0);
        std::vector<std::uint16_t> fits(cells, 0);
        for (std::size_t row = 0, from = 0; row < terrain.rows; ++row) {
            for (std::size_t column = 0; column < terrain.columns; ++column, ++from) {
                if (terrain.costs[from] == kClosed) continue;
                const std::size_t cell = (row + kMargin) * stride + kMargin + column;
                open[cell] = 1;
                fits[cell] = space.fits[from];
                const int cost = std::min<int>(terrain.costs[from], 252);
                worth[cell] = 0.5 + 0.5 * terrain.slow * cost / 252;
            }
        }
        for (int h = 0; h < 16; ++h) {
            offsets[h] = offset(kMoves[h].rows, kMoves[h].columns);
            lengths[h] = std::hypot(kMoves[h].rows, kMoves[h].columns);
        }
        for (std::size_t row = 0, from = 0; row < terrain.rows; ++row) {
            for (std::size_t column = 0; column < terrain.columns; ++column, ++from) {
                const std::size_t cell = (row + kMargin) * stride + kMargin + column;
                unsigned left = space.steps[from] & fits[cell];
                for (; left != 0; left &= left - 1) {
                    const int h = __builtin_ctz(left);
                    if (is_open(open, cell, kMoves[h]) && (fits[at(cell, h)] >> h & 1u))
                        steps[cell] = static_cast<std::uint16_t>(steps[cell] | 1u << h);
                }
            }
        }
        for (std::size_t cell = 0; cell < cells; ++cell) {
            first[cell] = static_cast<std::uint32_t>(headings.size());
            if (fits[cell] == 0) continue;
            const std::size_t row = cell / stride - kMargin, column = cell % stride - kMargin;
            add(cell, fits[cell], space.turns[row * terrain.columns + column]);
        }
        first[cells] = static_cast<std::uint32_t>(headings.size());
    }

    std::ptrdiff_t offset(int rows, int columns) const {
        return rows * static_cast<std::ptrdiff_t>(stride) + columns;
    }

    std::size_t at(std::size_t cell, int h, bool ahead = true) const {
        return cell + static_cast<std::size_t>(ahead ? offsets[h] : -offsets[h]);
    }

    std::size_t index(Cell cell) const {
        return (static_cast<std::size_t>(cell.row) + kMargin) * stride + kMargin +
               static_cast<std::size_t>(cell.column);
    }

    Cell cell(std::size_t index) const {
        return {static_cast<std::int64_t>(index / stride - kMargin),
                static_cast<std::int64_t>(index % stride - kMargin)};
    }

    // The state at a cell that has a heading.
    std::uint32_t state(std::size_t cell, int h) const {
        std::uint32_t found = first[cell];
        while ((headings[found] >> h & 1u) == 0) ++found;
        return found;
    }

    std::size_t stride;
    std::size_t cells;
    double dearest;                       // the most that a step costs, by its length
    std::vector<std::uint32_t> first;     // state of each cell; the next cell's ends them
    std::vector<std::uint16_t> steps;     // by heading, from each cell ahead
    std::vector<double> worth;            // half of what a metre costs at each cell
    std::vector<std::uint16_t> headings;  // of each state
    std::vector<std::uint32_t> cell_of;   // of each state
    std::ptrdiff_t offsets[16];
    double lengths[16];

  private:
    // Whether the cells beside a step are those that the origin may pass.
    bool is_open(const std::vector<std::uint8_t>& open, std::size_t cell, Move move) const {
        const int rows = move.rows, columns = move.columns;
        std::ptrdiff_t one = offset(rows, 0), other = offset(0, columns);
        if (std::abs(rows) == 2) one = offset(rows / 2, 0), other = offset(rows / 2, columns);
        if (std::abs(columns) == 2) one = offset(0, columns / 2), other = offset(rows, columns / 2);
        return open[cell + static_cast<std::size_t>(one)] != 0 &&
               open[cell + static_cast<std::size_t>(other)] != 0;
    }

    // Adds the states of a cell: the runs of headings that turns join, around the circle.
    void add(std::size_t cell, unsigned fits, unsigned turns) {
        // Bit h: headings h and h + 1 fit, and the turn between them.
        const unsigned joins = turns & fits & (fits >> 1 | fits << 15) & kAll;
        if (joins == kAll) return push(cell, kAll);
        for (int h = 0; h < 16; ++h) {
            if ((fits >> h & 1u) == 0 || (joins >> ((h + 15) % 16) & 1u) != 0) continue;
            unsigned run = 1u << h;
            for (int k = h; (joins >> k & 1u) != 0; k = (k + 1) % 16) run |= 1u << (k + 1) % 16;
            push(cell, run);
        }
    }

    void push(std::size_t cell, unsigned run) {
        headings.push_back(static_cast<std::uint16_t>(run));
        cell_of.push_back(static_cast<std::uint32_t>(cell));
    }
};

// Dijkstra with buckets as wide as the cheapest step, as in travel.cpp; turns cost nothing, so that
// they are within a state.
class Search {
  public:
    explicit Search(const States& states)
        : states_(states),
          prices_(states.headings.size(), kNowhere),
          from_(states.headings.size(), kNone),
          by_(states.headings.size()),
          left_(states.headings.size(), 0),
          wanted_(states.cells, 0),
          buckets_(static_cast<std::size_t>(std::ceil(kLongest * states.dearest)) + 2) {}

    void run(std::size_t start, const std::vector<std::size_t>& goals) {
        for (const std::uint32_t state : touched_) {
            prices_[state] = kNowhere;
            from_[state] = kNone;
            left_[state] = 0;
        }
        touched_.clear();
        for (auto& bucket : buckets_) bucket.clear();
        std::size_t missing = 0;
        for (const std::size_t goal : goals) {
            missing += wanted_[goal] == 0;
            wanted_[goal] = 1;
        }
        std::size_t waiting = 0;
        for (std::uint32_t s = states_.first[start]; s < states_.first[start + 1]; ++s, ++waiting) {
            prices_[s] = 0.0;
            touched_.push_back(s);
            buckets_[0].push_back(s);
        }
        for (std::size_t number = 0; waiting > 0 && missing > 0; ++number) {
            auto& bucket = buckets_[number % buckets_.size()];
            waiting -= bucket.size();
            for (const std::uint32_t state : bucket) {
                if (left_[state] != 0) continue;
                left_[state] = 1;
                const std::size_t cell = states_.cell_of[state];
                missing -= wanted_[cell];
                wanted_[cell] = 0;
                waiting += leave(state, cell);
            }
            bucket.clear();
        }
        for (const std::size_t goal : goals) wanted_[goal] = 0;
    }

    // The state at a cell that was come to for the least; kNone if there is none.
    std::uint32_t best(std::size_t cell) const {
        std::uint32_t found = kNone;
        for (std::uint32_t s = states_.first[cell]; s < states_.first[cell + 1]; ++s) {
            if (prices_[s] < (found == kNone ? kNowhere : prices_[found])) found = s;
        }
        return found;
    }

    double price(std::uint32_t state) const { return prices_[state]; }

    // Calls step(state, heading by which it was come to) from the end of a way.
    template <typename Step>
    std::uint32_t backwards(std::uint32_t state, Step&& step) const {
        for (; from_[state] != kNone; state = from_[state]) step(state, by_[state]);
        return state;
    }

    double length(std::uint32_t state) const {
        std::size_t counts[3] = {0, 0, 0};
        backwards(state, [&](std::uint32_t, int h) { ++counts[h % 2 == 1 ? 2 : h % 4 / 2]; });
        return static_cast<double>(counts[0]) +
               static_cast<double>(counts[1]) * states_.lengths[2] +
               static_cast<double>(counts[2]) * states_.lengths[1];
    }

  private:
    // Tries the steps from a state; how many states came into buckets.
    std::size_t leave(std::uint32_t state, std::size_t cell) {
        std::size_t count = 0;
        const unsigned own = states_.headings[state];
        const unsigned ahead = own & states_.steps[cell];
        for (unsigned left = ahead; left != 0; left &= left - 1) {
            const int h = __builtin_ctz(left);
            count += relax(state, cell, states_.at(cell, h), h);
        }
        for (unsigned left = own; left != 0; left &= left - 1) {
            const int h = __builtin_ctz(left);
            const std::size_t next = states_.at(cell, h, false);
            if ((states_.steps[next] >> h & 1u) == 0) continue;
            // A shape that turns freely there has come to it ahead.
            if ((ahead >> (h ^ 8) & 1u) != 0 && states_.headings[states_.first[next]] == kAll)
                continue;
            count += relax(state, cell, next, h);
        }
        return count;
    }

    std::size_t relax(std::uint32_t state, std::size_t cell, std::size_t next, int h) {
        const std::uint32_t there = states_.state(next, h);
        const double price =
            prices_[state] + states_.lengths[h] * (states_.worth[cell] + states_.worth[next]);
        if (price >= prices_[there]) return 0;
        if (prices_[there] == kNowhere) touched_.push_back(there);
        prices_[there] = price;
        from_[there] = state;
        by_[there] = static_cast<std::uint8_t>(h);
        buckets_[static_cast<std::size_t>(price) % buckets_.size()].push_back(there);
        return 1;
    }

    const States& states_;
    std::vector<double> prices_;
    std::vector<std::uint32_t> from_;
    std::vector<std::uint8_t> by_;
    std::vector<std::uint8_t> left_;    // whether the price is final
    std::vector<std::uint8_t> wanted_;  // goals, by cell
    std::vector<std::vector<std::uint32_t>> buckets_;
    std::vector<std::uint32_t> touched_;
};

}  // namespace

bool drive(const Space& space, const std::vector<Cell>& starts, const std::vector<Cell>& goals,
           unsigned threads, double* prices, double* metres) {
    const std::size_t width = goals.size();
    std::fill_n(prices, starts.size() * width, kNowhere);
    std::fill_n(metres, starts.size() * width, kNowhere);
    const States states(space);
    std::vector<std::size_t> wanted;
    for (const Cell goal : goals) {
        const std::size_t cell = states.index(goal);
        if (states.first[cell] < states.first[cell + 1]) wanted.push_back(cell);
    }
    return Team(threads).share(threads, 1, [&](unsigned, std::size_t part, std::size_t) {
        Search search(states);
        for (std::size_t i = part; i < starts.size(); i += threads) {
            search.run(states.index(starts[i]), wanted);
            for (std::size_t j = 0; j < width; ++j) {
                const std::uint32_t state = search.best(states.index(goals[j]));
                if (state == kNone) continue;
                prices[i * width + j] = search.price(state) * space.terrain.resolution;
                metres[i * width + j] = search.length(state) * space.terrain.resolution;
            }
        }
    });
}

std::vector<Stand> drive_way(const Space& space, Cell start, Cell goal) {
    const States states(space);
    const std::size_t last = states.index(goal);
    std::vector<Stand> stands;
    Search search(states);
    search.run(states.index(start), {last});
    const std::uint32_t end = search.best(last);
    if (end == kNone) return stands;
    int heading = -1;
    const std::uint32_t begin = search.backwards(end, [&](std::uint32_t state, int h) {
        stands.push_back({states.cell(states.cell_of[state]), h});
        heading = h;
    });
    if (heading < 0) heading = __builtin_ctz(states.headings[begin]);
    stands.push_back({start, heading});
    std::reverse(stands.begin(), stands.end());
    return stands;
}

}  // namespace semmap
