// A few threads that do one piece of work together.
#pragma once

#include <atomic>
#include <cstddef>
#include <exception>
#include <mutex>
#include <system_error>
#include <thread>
#include <vector>

namespace semmap {

class Team {
  public:
    explicit Team(unsigned threads) : threads_(threads) {}

    unsigned size() const { return threads_; }

    // Calls work(thread, first, last) on chunks of 0..count until all are done, each chunk once.
    // Throws what one of them threw.
    template <typename Work>
    void share(std::size_t count, std::size_t chunk, Work&& work) const {
        std::atomic<std::size_t> next{0};
        std::exception_ptr thrown;
        std::mutex mutex;
        const auto member = [&](unsigned thread) {
            try {
                for (;;) {
                    const std::size_t first = next.fetch_add(chunk);
                    if (first >= count) return;
                    work(thread, first, count - first < chunk ? count : first + chunk);
                }
            } catch (...) {
                const std::lock_guard lock(mutex);
                thrown = std::current_exception();
                next = count;
            }
        };
        std::vector<std::thread> others;
        try {
            others.reserve(threads_);
            for (unsigned i = 1; i < threads_ && i * chunk < count; ++i) {
                others.emplace_back(member, i);
            }
        } catch (const std::system_error&) {
            // No more threads to be had: those that there are do the work.
        }
        member(0);
        for (std::thread& other : others) other.join();
        if (thrown) std::rethrow_exception(thrown);
    }

  private:
    unsigned threads_;
};

}  // namespace semmap
