#include "semmap/ways.hpp"

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
constexpr std::uint8_t kBack = 16;   // in `by`: against the heading
constexpr std::uint8_t kStart = 32;  // no step
constexpr double kLongest = 2.2360679774997898;

// In rows and columns; the way back of a move is the one 8 before or after it.
constexpr int kMoves[16][2] = {
    {0, 1},  {1, 2},   {1, 1},   {2, 1},   {1, 0},  {2, -1}, {1, -1}, {1, -2},
    {0, -1}, {-1, -2}, {-1, -1}, {-2, -1}, {-1, 0}, {-2, 1}, {-1, 1}, {-1, 2},
};

// The grid with a margin that is not passed, so that no step leaves it.
struct Lattice {
    // Cells of `closed` and more are not passed.
    Lattice(const Terrain& terrain, int closed)
        : stride(terrain.columns + 2 * kMargin),
          cells(stride * (terrain.rows + 2 * kMargin)),
          dearest(1.0 + terrain.slow),
          worth(cells, kNowhere) {
        double worths[256];
        for (int cost = 0; cost < 256; ++cost) {
            worths[cost] =
                cost < closed ? 0.5 + 0.5 * terrain.slow * std::min(cost, 252) / 252 : kNowhere;
        }
        for (std::size_t row = 0; row < terrain.rows; ++row) {
            const std::uint8_t* costs = terrain.costs + row * terrain.columns;
            double* at = worth.data() + (row + kMargin) * stride + kMargin;
            for (std::size_t i = 0; i < terrain.columns; ++i) at[i] = worths[costs[i]];
        }
        for (int h = 0; h < 16; ++h) {
            const int rows = kMoves[h][0], columns = kMoves[h][1];
            offsets[h] = offset(rows, columns);
            lengths[h] = std::hypot(rows, columns);
            // For a knight's move the two cells between; for a straight one its ends.
            const bool diagonal = std::abs(rows) == std::abs(columns);
            beside[h][0] = diagonal ? offset(rows, 0) : offset(rows / 2, columns / 2);
            beside[h][1] = offsets[h] - beside[h][0];
        }
    }

    std::ptrdiff_t offset(int rows, int columns) const {
        return rows * static_cast<std::ptrdiff_t>(stride) + columns;
    }

    std::size_t index(Cell cell) const {
        return (static_cast<std::size_t>(cell.row) + kMargin) * stride + kMargin +
               static_cast<std::size_t>(cell.column);
    }

    Cell cell(std::size_t index) const {
        return {static_cast<std::int64_t>(index / stride - kMargin),
                static_cast<std::int64_t>(index % stride - kMargin)};
    }

    bool is_open(std::size_t cell) const { return worth[cell] < kNowhere; }

    std::size_t stride;
    std::size_t cells;
    double dearest;             // the most that a step costs, by its length
    std::vector<double> worth;  // half of what a metre costs at each cell
    std::ptrdiff_t offsets[16];
    std::ptrdiff_t beside[16][2];
    double lengths[16];
};

// The states of a search are at cells: those of a cell follow each other, from `first` to `end`. A
// point has one, whatever its heading.
struct PointStates : Lattice {
    explicit PointStates(const Terrain& terrain) : Lattice(terrain, 253), moves(cells, 0) {
        std::vector<std::uint8_t> open(cells);
        for (std::size_t cell = 0; cell < cells; ++cell) open[cell] = is_open(cell);
        const auto begin = static_cast<std::ptrdiff_t>(kMargin * stride + kMargin);
        const auto past = static_cast<std::ptrdiff_t>(cells) - begin;
        for (int h = 0; h < 16; ++h) {
            const std::ptrdiff_t one = beside[h][0], other = beside[h][1], next = offsets[h];
            const std::uint8_t* at = open.data();
            std::uint16_t* found = moves.data();
            for (std::ptrdiff_t cell = begin; cell < past; ++cell) {
                const unsigned free =
                    at[cell] & at[cell + one] & at[cell + other] & at[cell + next];
                found[cell] = static_cast<std::uint16_t>(found[cell] | free << h);
            }
        }
    }

    std::size_t size() const { return cells; }
    std::size_t first(std::size_t cell) const { return cell; }
    std::size_t end(std::size_t cell) const { return is_open(cell) ? cell + 1 : cell; }
    std::size_t cell_of(std::size_t state) const { return state; }
    int heading(std::size_t) const { return 0; }

    // The state from which a step led to a state.
    std::size_t before(std::size_t state, std::uint8_t by) const {
        return state - static_cast<std::size_t>(offsets[by]);
    }

    // Calls step(state, its cell, by) for each step.
    template <typename Step>
    void leave(std::size_t, std::size_t cell, Step&& step) const {
        for (unsigned left = moves[cell]; left != 0; left &= left - 1) {
            const int h = __builtin_ctz(left);
            const std::size_t next = cell + static_cast<std::size_t>(offsets[h]);
            step(next, next, static_cast<std::uint8_t>(h));
        }
    }

    std::vector<std::uint16_t> moves;  // that each cell has
};

// A shape has a state for the headings among which it can turn. Most cells have one.
struct ShapeStates : Lattice {
    explicit ShapeStates(const Space& space)
        : Lattice(space.terrain, 255), firsts(cells + 1), steps(cells, 0) {
        const Terrain& terrain = space.terrain;
        std::vector<std::uint16_t> fits(cells, 0);
        // Calls each(cell, its number in `space`) for all cells of the terrain.
        const auto for_each_cell = [&](auto&& each) {
            for (std::size_t row = 0, from = 0; row < terrain.rows; ++row) {
                const std::size_t cell = (row + kMargin) * stride + kMargin;
                for (std::size_t i = 0; i < terrain.columns; ++i, ++from) each(cell + i, from);
            }
        };
        for_each_cell([&](std::size_t cell, std::size_t from) {
            if (is_open(cell)) fits[cell] = space.fits[from];
        });
        for_each_cell([&](std::size_t cell, std::size_t from) {
            for (unsigned left = space.steps[from] & fits[cell]; left != 0; left &= left - 1) {
                const int h = __builtin_ctz(left);
                if (is_open(cell + static_cast<std::size_t>(beside[h][0])) &&
                    is_open(cell + static_cast<std::size_t>(beside[h][1])) &&
                    (fits[at(cell, h)] >> h & 1u))
                    steps[cell] = static_cast<std::uint16_t>(steps[cell] | 1u << h);
            }
        });
        for (std::size_t cell = 0; cell < cells; ++cell) {
            firsts[cell] = static_cast<std::uint32_t>(headings.size());
            if (fits[cell] == 0) continue;
            const std::size_t row = cell / stride - kMargin, column = cell % stride - kMargin;
            add(cell, fits[cell], space.turns[row * terrain.columns + column]);
        }
        firsts[cells] = static_cast<std::uint32_t>(headings.size());
    }

    std::size_t size() const { return headings.size(); }
    std::size_t first(std::size_t cell) const { return firsts[cell]; }
    std::size_t end(std::size_t cell) const { return firsts[cell + 1]; }
    std::size_t cell_of(std::size_t state) const { return cells_of[state]; }
    int heading(std::size_t state) const { return __builtin_ctz(headings[state]); }

    std::size_t before(std::size_t state, std::uint8_t by) const {
        const int h = by & 15;
        return state_at(at(cells_of[state], h, by >= kBack), h);
    }

    template <typename Step>
    void leave(std::size_t state, std::size_t cell, Step&& step) const {
        const unsigned own = headings[state];
        const unsigned ahead = own & steps[cell];
        for (unsigned left = ahead; left != 0; left &= left - 1) {
            const int h = __builtin_ctz(left);
            const std::size_t next = at(cell, h);
            step(state_at(next, h), next, static_cast<std::uint8_t>(h));
        }
        for (unsigned left = own; left != 0; left &= left - 1) {
            const int h = __builtin_ctz(left);
            const std::size_t next = at(cell, h, false);
            if ((steps[next] >> h & 1u) == 0) continue;
            // A shape that turns freely there has come to it ahead.
            if ((ahead >> (h ^ 8) & 1u) != 0 && headings[firsts[next]] == kAll) continue;
            step(state_at(next, h), next, static_cast<std::uint8_t>(h | kBack));
        }
    }

  private:
    std::size_t at(std::size_t cell, int h, bool ahead = true) const {
        return cell + static_cast<std::size_t>(ahead ? offsets[h] : -offsets[h]);
    }

    // The state at a cell that has a heading.
    std::size_t state_at(std::size_t cell, int h) const {
        std::size_t found = firsts[cell];
        while ((headings[found] >> h & 1u) == 0) ++found;
        return found;
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
        cells_of.push_back(static_cast<std::uint32_t>(cell));
    }

    std::vector<std::uint32_t> firsts;    // state of each cell; the next cell's ends them
    std::vector<std::uint16_t> steps;     // by heading, from each cell ahead
    std::vector<std::uint16_t> headings;  // of each state
    std::vector<std::uint32_t> cells_of;  // of each state
};

// Dijkstra with buckets that are as wide as the cheapest step (Denardo and Fox, Shortest-route
// methods 1, 1979): all states in the first bucket have their final price, in any order, so that
// nothing is compared. Prices are doubles, in cells.
template <typename States>
class Search {
  public:
    explicit Search(const States& states)
        : states_(states),
          prices_(states.size(), kNowhere),
          by_(states.size()),
          left_(states.size(), 0),
          wanted_(states.cells, 0),
          buckets_(static_cast<std::size_t>(std::ceil(kLongest * states.dearest)) + 2) {}

    // Finds the ways from a cell to others, all of which have states.
    void run(std::size_t start, const std::vector<std::size_t>& goals) {
        for (const std::uint32_t state : touched_) {
            prices_[state] = kNowhere;
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
        const auto reach = [&](std::size_t state, double price, std::uint8_t by) {
            if (price >= prices_[state]) return;
            if (prices_[state] == kNowhere) touched_.push_back(static_cast<std::uint32_t>(state));
            prices_[state] = price;
            by_[state] = by;
            buckets_[static_cast<std::size_t>(price) % buckets_.size()].push_back(
                static_cast<std::uint32_t>(state));
            ++waiting;
        };
        for (std::size_t s = states_.first(start); s < states_.end(start); ++s) {
            reach(s, 0.0, kStart);
        }
        for (std::size_t number = 0; waiting > 0 && missing > 0; ++number) {
            auto& bucket = buckets_[number % buckets_.size()];
            waiting -= bucket.size();
            for (const std::uint32_t state : bucket) {
                if (left_[state] != 0) continue;
                left_[state] = 1;
                const std::size_t cell = states_.cell_of(state);
                missing -= wanted_[cell];
                wanted_[cell] = 0;
                const double price = prices_[state], worth = states_.worth[cell];
                states_.leave(state, cell, [&](std::size_t next, std::size_t at, std::uint8_t by) {
                    reach(next, price + states_.lengths[by & 15] * (worth + states_.worth[at]), by);
                });
            }
            bucket.clear();
        }
        for (const std::size_t goal : goals) wanted_[goal] = 0;
    }

    // The state at a cell that was come to for the least; kNone if there is none.
    std::size_t best(std::size_t cell) const {
        std::size_t found = kNone;
        double least = kNowhere;
        for (std::size_t s = states_.first(cell); s < states_.end(cell); ++s) {
            if (prices_[s] >= least) continue;
            least = prices_[s];
            found = s;
        }
        return found;
    }

    double price(std::size_t state) const { return prices_[state]; }

    // Calls step(state, by) for each step into a state of the way, from its end; where it begins.
    template <typename Step>
    std::size_t backwards(std::size_t state, Step&& step) const {
        for (; by_[state] != kStart; state = states_.before(state, by_[state])) {
            step(state, by_[state]);
        }
        return state;
    }

    double length(std::size_t state) const {
        std::size_t straight = 0, diagonal = 0, knight = 0;
        backwards(state, [&](std::size_t, std::uint8_t by) {
            ++(by % 2 == 1 ? knight : by % 4 == 2 ? diagonal : straight);
        });
        return static_cast<double>(straight) + static_cast<double>(diagonal) * states_.lengths[2] +
               static_cast<double>(knight) * states_.lengths[1];
    }

  private:
    const States& states_;
    std::vector<double> prices_;
    std::vector<std::uint8_t> by_;      // the step by which each state was come to
    std::vector<std::uint8_t> left_;    // whether the price is final
    std::vector<std::uint8_t> wanted_;  // goals, by cell
    std::vector<std::vector<std::uint32_t>> buckets_;
    std::vector<std::uint32_t> touched_;
};

template <typename States>
void all_ways(const States& states, double resolution, const std::vector<Cell>& starts,
              const std::vector<Cell>& goals, bool among, unsigned threads, double* prices,
              double* metres) {
    const std::size_t width = goals.size();
    std::fill_n(prices, starts.size() * width, kNowhere);
    std::fill_n(metres, starts.size() * width, kNowhere);
    Team(threads).share(threads, 1, [&](unsigned, std::size_t part, std::size_t) {
        Search search(states);
        std::vector<std::size_t> wanted;
        for (std::size_t i = part; i < starts.size(); i += threads) {
            const std::size_t first = among ? i : 0;
            wanted.clear();
            for (std::size_t j = first; j < width; ++j) {
                const std::size_t goal = states.index(goals[j]);
                if (states.first(goal) < states.end(goal)) wanted.push_back(goal);
            }
            search.run(states.index(starts[i]), wanted);
            for (std::size_t j = first; j < width; ++j) {
                const std::size_t state = search.best(states.index(goals[j]));
                if (state == kNone) continue;
                const double price = search.price(state) * resolution;
                const double length = search.length(state) * resolution;
                prices[i * width + j] = price;
                metres[i * width + j] = length;
                if (among) {  // a way back is the way there
                    prices[j * width + i] = price;
                    metres[j * width + i] = length;
                }
            }
        }
    });
}

template <typename States>
std::vector<Stand> one_way(const States& states, Cell start, Cell goal) {
    const std::size_t last = states.index(goal);
    std::vector<Stand> stands;
    if (states.first(last) == states.end(last)) return stands;
    Search search(states);
    search.run(states.index(start), {last});
    const std::size_t end = search.best(last);
    if (end == kNone) return stands;
    const std::size_t begin = search.backwards(end, [&](std::size_t state, std::uint8_t by) {
        stands.push_back({states.cell(states.cell_of(state)), by & 15});
    });
    stands.push_back({start, stands.empty() ? states.heading(begin) : stands.back().heading});
    std::reverse(stands.begin(), stands.end());
    return stands;
}

}  // namespace

void travel(const Terrain& terrain, const std::vector<Cell>& starts, const std::vector<Cell>& goals,
            bool among, unsigned threads, double* prices, double* metres) {
    all_ways(PointStates(terrain), terrain.resolution, starts, goals, among, threads, prices,
             metres);
}

void drive(const Space& space, const std::vector<Cell>& starts, const std::vector<Cell>& goals,
           bool among, unsigned threads, double* prices, double* metres) {
    all_ways(ShapeStates(space), space.terrain.resolution, starts, goals, among, threads, prices,
             metres);
}

std::vector<Stand> way(const Terrain& terrain, Cell start, Cell goal) {
    return one_way(PointStates(terrain), start, goal);
}

std::vector<Stand> drive_way(const Space& space, Cell start, Cell goal) {
    return one_way(ShapeStates(space), start, goal);
}

}  // namespace semmap
