// Extended Kalman filter with constant velocity: px, py, vx, vy.
#include "passage.hpp"

constexpr double acceleration_sigma = ACCELERATION_SIGMA;

struct EkfCv {
    static constexpr int size = 4;
    Matrix<4> mean;
    Matrix<4, 4> covariance, transition, noise;

    EkfCv(const Matrix<4>& mean, const Matrix<4, 4>& covariance, double dt) : mean(mean), covariance(covariance) {
        transition << 1, 0, dt, 0, 0, 1, 0, dt, 0, 0, 1, 0, 0, 0, 0, 1;
        Matrix<4, 2> gain;
        gain << dt * dt / 2, 0, 0, dt * dt / 2, dt, 0, 0, dt;
        noise = acceleration_sigma * acceleration_sigma * gain * gain.transpose();
    }

    void predict() {
        mean = transition * mean;
        covariance = transition * covariance * transition.transpose() + noise;
    }

    void update_radar(const Matrix<3>& measured, const Matrix<3, 3>& noise) {
        const double px = mean[0], py = mean[1], vx = mean[2], vy = mean[3];
        const double square = px * px + py * py, r = std::sqrt(square), across = (vx * py - vy * px) / (r * square);
        Matrix<3, 4> jacobian;
        jacobian << px / r, py / r, 0, 0, -py / square, px / square, 0, 0, py * across, -px * across, px / r, py / r;
        Matrix<3> innovation = measured - Matrix<3>(r, std::atan2(py, px), (px * vx + py * vy) / r);
        innovation[1] = wrapped(innovation[1]);
        correct(innovation, jacobian, noise);
    }

    void update_lidar(const Matrix<2>& measured, const Matrix<2, 2>& noise) {
        correct<2>(measured - mean.head<2>(), Matrix<2, 4>::Identity(), noise);
    }

    template <int m>
    void correct(const Matrix<m>& innovation, const Matrix<m, 4>& jacobian, const Matrix<m, m>& noise) {
        const Matrix<4, m> cross = covariance * jacobian.transpose();
        const Matrix<m, m> spread = jacobian * cross + noise;
        const Matrix<4, m> gain = cross * spread.inverse();
        mean += gain * innovation;
        covariance -= gain * cross.transpose();
        // What rounding makes unsymmetric would grow.
        covariance = (covariance + covariance.transpose()).eval() / 2;
    }
};

int main(int, char** arguments) { return passage<EkfCv>(arguments[1], arguments[2]); }
