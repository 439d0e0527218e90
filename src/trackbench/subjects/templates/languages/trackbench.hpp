// A tracker in C++17 for trackbench: write a class and TRACKBENCH_TRACKER(Class). See trackbench.h for how it is compiled.
#ifndef TRACKBENCH_HPP
#define TRACKBENCH_HPP

#include "trackbench.h"

#include <algorithm>
#include <array>
#include <exception>
#include <optional>
#include <string>
#include <type_traits>
#include <vector>

namespace trackbench {

using Scan = tb_scan;

// One object: px, py, vx, vy in the fixed frame, and their covariance, row by row.
struct Estimate {
    std::array<double, 4> mean;
    std::array<double, 16> covariance;
};

// Several objects: (K), (4, K), (4, 4, K), and (K) or nothing.
struct Tracks {
    std::vector<double> ids, mean, covariance, existence, used;
};

// Those of the scenario, and arguments --key value of the command.
class Options {
public:
    explicit Options(const char *json, bool hidden = false) : hidden(hidden), json_(json) {}
    double number(const char *key, double otherwise) const { return tb_number(json_.c_str(), key, otherwise); }
    const std::string &json() const { return json_; }
    const bool hidden;  // whether the identities are

private:
    std::string json_;
};

// What trackbench.h asks for, of a class. Its step(scan) returns std::optional<Estimate> or Tracks; of one that takes
// batches (static constexpr bool batched = true) step(scan, mean, covariance) fills (4, n) and (4, 4, n) and returns
// whether there is an estimate.
template <class Tracker>
struct Served {
    Tracker tracker;
    Tracks tracks{};
    std::string error{};
};

template <class T, class = void> struct is_batched : std::false_type {};
template <class T> struct is_batched<T, std::void_t<decltype(T::batched)>> : std::bool_constant<T::batched> {};
template <class T, class = void> struct is_random : std::false_type {};
template <class T> struct is_random<T, std::void_t<decltype(T::random)>> : std::bool_constant<T::random> {};

template <class Tracker>
void *create(const char *options, bool hidden) {
    try {
        return new Served<Tracker>{Tracker(Options(options, hidden))};
    } catch (const std::exception &error) {
        fprintf(stderr, "%s\n", error.what());
        return nullptr;
    }
}

template <class Tracker>
int64_t answer(Served<Tracker> &served, const tb_scan &scan, tb_answer &answer) {
    if constexpr (is_batched<Tracker>::value) {
        return served.tracker.step(scan, answer.mean, answer.covariance) ? TB_ESTIMATE : TB_NONE;
    } else {
        auto result = served.tracker.step(scan);
        if constexpr (std::is_same_v<decltype(result), Tracks>) {
            served.tracks = std::move(result);
            Tracks &tracks = served.tracks;
            answer.tracks = static_cast<int64_t>(tracks.ids.size());
            answer.ids = tracks.ids.data();
            answer.mean = tracks.mean.data();
            answer.covariance = tracks.covariance.data();
            answer.existence = tracks.existence.empty() ? nullptr : tracks.existence.data();
            answer.used = tracks.used.empty() ? nullptr : tracks.used.data();
            return TB_TRACKS;
        } else {
            if (!result) return TB_NONE;
            std::copy(result->mean.begin(), result->mean.end(), answer.mean);
            std::copy(result->covariance.begin(), result->covariance.end(), answer.covariance);
            return TB_ESTIMATE;
        }
    }
}

template <class Tracker>
int64_t step(void *tracker, const tb_scan &scan, tb_answer &result) {
    auto &served = *static_cast<Served<Tracker> *>(tracker);
    try {
        return answer(served, scan, result);
    } catch (const std::exception &error) {
        served.error = error.what();
    } catch (...) {
        served.error = "it threw what is no std::exception";
    }
    result.error = served.error.c_str();
    return TB_FAILED;
}

template <class Tracker>
void *copy(const void *tracker) {
    if constexpr (std::is_copy_constructible_v<Tracker>) {
        return new Served<Tracker>{static_cast<const Served<Tracker> *>(tracker)->tracker};
    } else {
        return nullptr;
    }
}

}  // namespace trackbench

#ifdef TRACKBENCH_PROGRAM
#define TRACKBENCH_MAIN \
    int main(int argc, char **argv) { return tb_main(argc, argv); }
#else
#define TRACKBENCH_MAIN
#endif

#define TRACKBENCH_TRACKER(Class)                                                                                     \
    extern "C" {                                                                                                      \
    void tb_describe(tb_traits *traits) {                                                                             \
        *traits = {TB_ABI, #Class, trackbench::is_batched<Class>::value, trackbench::is_random<Class>::value,         \
                   std::is_copy_constructible_v<Class>};                                                              \
    }                                                                                                                 \
    void *tb_create(const char *options, int64_t hidden) { return trackbench::create<Class>(options, hidden != 0); }  \
    int64_t tb_step(void *tracker, const tb_scan *scan, tb_answer *answer) {                                          \
        return trackbench::step<Class>(tracker, *scan, *answer);                                                      \
    }                                                                                                                 \
    void *tb_copy(const void *tracker) { return trackbench::copy<Class>(tracker); }                                   \
    void tb_destroy(void *tracker) { delete static_cast<trackbench::Served<Class> *>(tracker); }                      \
    }                                                                                                                 \
    TRACKBENCH_MAIN

#endif
