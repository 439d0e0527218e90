// Unscented Kalman filter with constant turn rate and velocity: px, py, speed, yaw, yaw rate; the process noise is added to
// the predicted covariance, and the sigma points are drawn anew for the update.
#include "passage.hpp"

constexpr double acceleration_sigma = ACCELERATION_SIGMA, yaw_acceleration_sigma = YAW_ACCELERATION_SIGMA;

struct UkfCtrv {
    static constexpr int size = 5, points = 2 * size + 1, yaw = 3;
    // Of alpha 1, beta 2 and kappa 0; the centre has no weight in the mean.
    static constexpr double centre_weight = 2.0, weight = 0.5 / size;
    Matrix<5> mean;
    Matrix<5, 5> covariance;
    double dt;

    UkfCtrv(const Matrix<5>& mean, const Matrix<5, 5>& covariance, double dt)
        : mean(mean), covariance(covariance), dt(dt) {}

    void predict() {
        const Matrix<5, 5> noise = process_noise();
        Matrix<5, points> moved = sigma_points();
        for (int i = 0; i < points; ++i) moved.col(i) = transition(moved.col(i));
        Matrix<5, points> away = moved.colwise() - moved.col(0);
        for (int i = 1; i < points; ++i) away(yaw, i) = wrapped(away(yaw, i));
        const Matrix<5> shift = weight * away.rowwise().sum();
        away.colwise() -= shift;
        mean = moved.col(0) + shift;
        mean[yaw] = wrapped(mean[yaw]);
        covariance = weighted(away, away) + noise;
    }

    void update_radar(const Matrix<3>& measured, const Matrix<3, 3>& noise) {
        update<1>(measured, noise, [](const Matrix<5>& x) {
            const double r = std::sqrt(x[0] * x[0] + x[1] * x[1]);
            return Matrix<3>(r, std::atan2(x[1], x[0]), (x[0] * std::cos(x[yaw]) + x[1] * std::sin(x[yaw])) * x[2] / r);
        });
    }

    void update_lidar(const Matrix<2>& measured, const Matrix<2, 2>& noise) {
        update<-1>(measured, noise, [](const Matrix<5>& x) -> Matrix<2> { return x.head<2>(); });
    }

    // `angle`: which component of the measurement is one; -1: none.
    template <int angle, int m, class Measure>
    void update(const Matrix<m>& measured, const Matrix<m, m>& noise, Measure measure) {
        const Matrix<5, points> drawn = sigma_points();
        Matrix<m, points> seen;
        for (int i = 0; i < points; ++i) seen.col(i) = measure(drawn.col(i));
        Matrix<m, points> away = seen.colwise() - seen.col(0);
        if constexpr (angle >= 0)
            for (int i = 1; i < points; ++i) away(angle, i) = wrapped(away(angle, i));
        const Matrix<m> shift = weight * away.rowwise().sum();
        away.colwise() -= shift;
        const Matrix<5, points> state_away = drawn.colwise() - mean;
        const Matrix<m, m> spread = weighted(away, away) + noise;
        const Matrix<5, m> cross = weighted(state_away, away), gain = cross * spread.inverse();
        Matrix<m> innovation = measured - seen.col(0) - shift;
        if constexpr (angle >= 0) innovation[angle] = wrapped(innovation[angle]);
        mean += gain * innovation;
        mean[yaw] = wrapped(mean[yaw]);
        covariance -= gain * cross.transpose();
    }

    Matrix<5, points> sigma_points() const {
        const Matrix<5, 5> columns = std::sqrt(double(size)) * covariance.llt().matrixL().toDenseMatrix();
        Matrix<5, points> found;
        found << mean, columns.colwise() + mean, (-columns).colwise() + mean;
        return found;
    }

    template <int rows, int columns>
    static Matrix<rows, columns> weighted(const Matrix<rows, points>& a, const Matrix<columns, points>& b) {
        const auto others = b.template rightCols<2 * size>().transpose();
        // At this size Eigen would take its product of large matrices, by blocks.
        return weight * a.template rightCols<2 * size>().lazyProduct(others) +
               centre_weight * a.col(0) * b.col(0).transpose();
    }

    Matrix<5> transition(const Matrix<5>& x) const {
        const double half = x[4] * dt / 2, along = x[2] * dt * (half == 0 ? 1 : std::sin(half) / half);
        Matrix<5> moved = x;
        moved[0] += along * std::cos(x[yaw] + half);
        moved[1] += along * std::sin(x[yaw] + half);
        moved[yaw] += x[4] * dt;
        return moved;
    }

    Matrix<5, 5> process_noise() const {
        const double c = dt * dt / 2 * std::cos(mean[yaw]), s = dt * dt / 2 * std::sin(mean[yaw]);
        Matrix<5, 2> gain;
        gain << c, 0, s, 0, dt, 0, 0, dt * dt / 2, 0, dt;
        gain.col(0) *= acceleration_sigma;
        gain.col(1) *= yaw_acceleration_sigma;
        return gain * gain.transpose();
    }
};

int main(int, char** arguments) { return passage<UkfCtrv>(arguments[1], arguments[2]); }
