// Takes a filter through the measurements of a file and writes its estimates to another one.
//
// Both files hold doubles only. First the numbers of runs and steps, the interval in s, the covariances of the radar's and
// of the lidar's noise, and that of the first belief; then of each run its mean; of each step 1 for a radar and 0 for a
// lidar; and of each run and step three numbers of the measurement, of which a lidar has two. The radar is at rest at the
// origin and looks along x; the first belief is of the first instant. Written: of each run and step the mean.
#pragma once

#include <Eigen/Dense>

#include <chrono>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <utility>
#include <vector>

template <int Rows, int Columns = 1>
using Matrix = Eigen::Matrix<double, Rows, Columns>;

constexpr double pi = 3.14159265358979323846;

inline double wrapped(double angle) { return angle - 2 * pi * std::rint(angle / (2 * pi)); }

inline std::vector<double> read(const char* name) {
    std::ifstream file(name, std::ios::binary | std::ios::ate);
    std::vector<double> numbers(static_cast<std::size_t>(file.tellg()) / sizeof(double));
    file.seekg(0);
    file.read(reinterpret_cast<char*>(numbers.data()), static_cast<std::streamsize>(numbers.size() * sizeof(double)));
    return numbers;
}

// Prints the seconds that the filter took; what is read and written from and to disk is not counted.
template <class Filter>
int passage(const char* from, const char* to) {
    constexpr int n = Filter::size;
    const std::vector<double> numbers = read(from);
    const double* next = numbers.data();
    const auto take = [&next](std::size_t count) { return std::exchange(next, next + count); };
    const auto runs = static_cast<std::size_t>(*take(1)), steps = static_cast<std::size_t>(*take(1));
    const double dt = *take(1);
    const Matrix<3, 3> radar_noise(take(9));
    const Matrix<2, 2> lidar_noise(take(4));
    const Matrix<n, n> covariance(take(n * n));
    const double *mean = take(runs * n), *is_radar = take(steps), *measured = take(3 * runs * steps);
    std::vector<double> estimates(runs * steps * n);
    double* place = estimates.data();

    const auto begin = std::chrono::steady_clock::now();
    for (std::size_t run = 0; run < runs; ++run, mean += n) {
        Filter filter(Matrix<n>(mean), covariance, dt);
        for (std::size_t step = 0; step < steps; ++step, measured += 3, place += n) {
            if (step > 0) filter.predict();
            if (is_radar[step] != 0)
                filter.update_radar(Matrix<3>(measured), radar_noise);
            else
                filter.update_lidar(Matrix<2>(measured), lidar_noise);
            Eigen::Map<Matrix<n>> estimate(place);
            estimate = filter.mean;
        }
    }
    const std::chrono::duration<double> seconds = std::chrono::steady_clock::now() - begin;

    std::ofstream file(to, std::ios::binary);
    file.write(reinterpret_cast<const char*>(estimates.data()),
               static_cast<std::streamsize>(estimates.size() * sizeof(double)));
    std::printf("%.9g\n", seconds.count());
    return file ? 0 : 1;
}
