#include "semmap/travel.hpp"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <limits>

#include "team.hpp"

namespace semmap {
namespace {

constexpr double kNowhere = std::numeric_limits<double>::infinity();
constexpr std::uint8_t kInscribed = 253;
constexpr std::size_t kMargin = 2;  // how far a step leads, in rows or columns
constexpr double kDiagonal = 1.4142135623730951;
constexpr double kKnight = 2.2360679774997898;

struct Move {
    int rows;
    int columns;
    double length;
};

// Each move's way back is the move 8 before or after it.
constexpr Move kMoves[16] = {
    {0, 1, 1.0},       {1, 0, 1.0},      {1, 1, kDiagonal},   {1, -1, kDiagonal},
    {1, 2, kKnight},   {1, -2, kKnight}, {2, 1, kKnight},     {2, -1, kKnight},
    {0, -1, 1.0},      {-1, 0, 1.0},     {-1, -1, kDiagonal}, {-1, 1, kDiagonal},
    {-1, -2, kKnight}, {-1, 2, kKnight}, {-2, -1, kKnight},   {-2, 1, kKnight},
};

// The grid with a margin that is not passed, so that no step leaves it: which moves each cell has.
struct Steps {
    explicit Steps(const Terrain& terrain)
        : stride(terrain.columns + 2 * kMargin),
          cells(stride * (terrain.rows + 2 * kMargin)),
          dearest(1.0 + terrain.slow),
          moves(cells, 0),
          worth(cells) {
        std::vector<std::uint8_t> passable(cells, 0);
        double worths[256];
        for (int cost = 0; cost < 256; ++cost) worths[cost] = 0.5 + 0.5 * terrain.slow * cost / 252;
        for (std::size_t row = 0; row < terrain.rows; ++row) {
            const std::uint8_t* costs = terrain.costs + row * terrain.columns;
            const std::size_t first = (row + kMargin) * stride + kMargin;
            for (std::size_t column = 0; column < terrain.columns; ++column) {
                passable[first + column] = costs[column] < kInscribed;
                worth[first + column] = worths[costs[column]];
            }
        }
        for (int i = 0; i < 16; ++i) offsets[i] = offset(kMoves[i].rows, kMoves[i].columns);
        const auto begin = static_cast<std::ptrdiff_t>(kMargin * stride + kMargin);
        const auto end = static_cast<std::ptrdiff_t>(cells) - begin;
        for (int i = 0; i < 16; ++i) {
            const int rows = kMoves[i].rows;
            const int columns = kMoves[i].columns;
            // What lies beside the step: for a knight's move the two cells between.
            std::ptrdiff_t one = offset(rows, 0), other = offset(0, columns);
            if (std::abs(rows) == 2) one = offset(rows / 2, 0), other = offset(rows / 2, columns);
            if (std::abs(columns) == 2)
                one = offset(0, columns / 2), other = offset(rows, columns / 2);
            const std::uint8_t* at = passable.data();
            std::uint16_t* found = moves.data();
            for (std::ptrdiff_t cell = begin; cell < end; ++cell) {
                const unsigned free =
                    at[cell] & at[cell + one] & at[cell + other] & at[cell + offsets[i]];
                found[cell] = static_cast<std::uint16_t>(found[cell] | free << i);
            }
        }
        for (std::size_t cell = 0; cell < cells; ++cell) {
            if (passable[cell] == 0) worth[cell] = kNowhere;
        }
    }

    std::ptrdiff_t offset(int rows, int columns) const {
        return rows * static_cast<std::ptrdiff_t>(stride) + columns;
    }

    std::size_t index(Cell cell) const {
        return (static_cast<std::size_t>(cell.row) + kMargin) * stride +
               static_cast<std::size_t>(cell.column) + kMargin;
    }

    Cell cell(std::size_t index) const {
        return {static_cast<std::int64_t>(index / stride - kMargin),
                static_cast<std::int64_t>(index % stride - kMargin)};
    }

    bool passable(std::size_t cell) const { return worth[cell] < kNowhere; }

    std::size_t stride;
    std::size_t cells;
    double dearest;  // the most that a step costs, by its length
    std::vector<std::uint16_t> moves;
    std::vector<double> worth;  // half of what a metre costs there
    std::ptrdiff_t offsets[16];
};

// Dijkstra with buckets that are as wide as the cheapest step (Denardo and Fox, Shortest-route
// methods 1, 1979): all cells in the first bucket have their final price, in any order, so that
// nothing is compared. Prices are doubles, in cells.
class Search {
  public:
    explicit Search(const Steps& steps)
        : steps_(steps),
          prices_(steps.cells, kNowhere),
          moves_(steps.cells),
          left_(steps.cells, 0),
          wanted_(steps.cells, 0),
          buckets_(static_cast<std::size_t>(std::ceil(kKnight * steps.dearest)) + 2) {}

    // Finds the ways from a cell to others, all of them passable.
    void run(std::size_t start, const std::vector<std::size_t>& goals) {
        for (const std::size_t cell : touched_) {
            prices_[cell] = kNowhere;
            left_[cell] = 0;
        }
        touched_.clear();
        for (auto& bucket : buckets_) bucket.clear();
        std::size_t missing = 0;
        for (const std::size_t goal : goals) {
            missing += wanted_[goal] == 0;
            wanted_[goal] = 1;
        }
        prices_[start] = 0.0;
        touched_.push_back(start);
        buckets_[0].push_back(start);
        std::size_t waiting = 1;
        for (std::size_t number = 0; waiting > 0 && missing > 0; ++number) {
            auto& bucket = buckets_[number % buckets_.size()];
            waiting -= bucket.size();
            for (const std::size_t cell : bucket) {
                if (left_[cell] != 0) continue;
                left_[cell] = 1;
                missing -= wanted_[cell];
                waiting += leave(cell);
            }
            bucket.clear();
        }
        for (const std::size_t goal : goals) wanted_[goal] = 0;
    }

    double price(std::size_t cell) const { return prices_[cell]; }

    // Calls step(cell, move into it) for each step of the way, from its end.
    template <typename Step>
    void backwards(std::size_t start, std::size_t goal, Step&& step) const {
        while (goal != start) {
            const std::uint8_t move = moves_[goal];
            step(goal, move);
            goal -= static_cast<std::size_t>(steps_.offsets[move]);
        }
    }

    double length(std::size_t start, std::size_t goal) const {
        std::size_t straight = 0, diagonal = 0, knight = 0;
        backwards(start, goal, [&](std::size_t, std::uint8_t move) {
            const unsigned kind = move & 7u;
            ++(kind < 2 ? straight : kind < 4 ? diagonal : knight);
        });
        return static_cast<double>(straight) + static_cast<double>(diagonal) * kDiagonal +
               static_cast<double>(knight) * kKnight;
    }

  private:
    // Tries the steps from a cell; how many cells came into buckets.
    std::size_t leave(std::size_t cell) {
        const double price = prices_[cell];
        const double worth = steps_.worth[cell];
        std::size_t count = 0;
        for (unsigned moves = steps_.moves[cell]; moves != 0; moves &= moves - 1) {
            const int move = __builtin_ctz(moves);
            const std::size_t next = cell + static_cast<std::size_t>(steps_.offsets[move]);
            const double there = price + kMoves[move].length * (worth + steps_.worth[next]);
            if (there < prices_[next]) {
                if (prices_[next] == kNowhere) touched_.push_back(next);
                prices_[next] = there;
                moves_[next] = static_cast<std::uint8_t>(move);
                buckets_[static_cast<std::size_t>(there) % buckets_.size()].push_back(next);
                ++count;
            }
        }
        return count;
    }

    const Steps& steps_;
    std::vector<double> prices_;
    std::vector<std::uint8_t> moves_;   // by which each cell was come to
    std::vector<std::uint8_t> left_;    // whether the price is final
    std::vector<std::uint8_t> wanted_;  // goals
    std::vector<std::vector<std::size_t>> buckets_;
    std::vector<std::size_t> touched_;
};

bool travel(const Terrain& terrain, const std::vector<Cell>& starts, const std::vector<Cell>& goals,
            bool among, unsigned threads, double* prices, double* metres) {
    const std::size_t width = goals.size();
    std::fill_n(prices, starts.size() * width, kNowhere);
    std::fill_n(metres, starts.size() * width, kNowhere);
    const Steps steps(terrain);
    return Team(threads).share(threads, 1, [&](unsigned, std::size_t part, std::size_t) {
        Search search(steps);
        std::vector<std::size_t> wanted;
        for (std::size_t i = part; i < starts.size(); i += threads) {
            const std::size_t start = steps.index(starts[i]);
            if (!steps.passable(start)) continue;
            const std::size_t first = among ? i : 0;
            wanted.clear();
            for (std::size_t j = first; j < width; ++j) {
                const std::size_t goal = steps.index(goals[j]);
                if (steps.passable(goal)) wanted.push_back(goal);
            }
            search.run(start, wanted);
            for (std::size_t j = first; j < width; ++j) {
                const std::size_t goal = steps.index(goals[j]);
                if (search.price(goal) == kNowhere) continue;
                const double price = search.price(goal) * terrain.resolution;
                const double length = search.length(start, goal) * terrain.resolution;
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

}  // namespace

bool travel(const Terrain& terrain, const std::vector<Cell>& starts, const std::vector<Cell>& goals,
            unsigned threads, double* prices, double* metres) {
    return travel(terrain, starts, goals, false, threads, prices, metres);
}

bool travel(const Terrain& terrain, const std::vector<Cell>& stands, unsigned threads,
            double* prices, double* metres) {
    return travel(terrain, stands, stands, true, threads, prices, metres);
}

std::vector<Cell> way(const Terrain& terrain, Cell start, Cell goal) {
    const Steps steps(terrain);
    const std::size_t first = steps.index(start);
    const std::size_t last = steps.index(goal);
    std::vector<Cell> cells;
    if (!steps.passable(first) || !steps.passable(last)) return cells;
    Search search(steps);
    search.run(first, {last});
    if (search.price(last) == kNowhere) return cells;
    search.backwards(first, last,
                     [&](std::size_t cell, std::uint8_t) { cells.push_back(steps.cell(cell)); });
    cells.push_back(start);
    std::reverse(cells.begin(), cells.end());
    return cells;
}

}  // namespace semmap
