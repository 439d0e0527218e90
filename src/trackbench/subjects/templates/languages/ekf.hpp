// An extended Kalman filter of constant velocity for the detections of a radar or a lidar. Units are SI and radians.
#ifndef TRACKBENCH_EKF_HPP
#define TRACKBENCH_EKF_HPP

#include "trackbench.hpp"

#include <algorithm>
#include <cmath>

namespace trackbench {

// What a detection says beside what was expected of it: W = P H^T L^-T and v = L^-1 (z - h(x)), with S = L L^T.
struct Innovation {
    int size = 0;
    double v[3] = {}, W[4][3] = {}, squared = 0.0, log_determinant = 0.0;
};

// px, py, vx, vy in the fixed frame, and their covariance.
struct Ekf {
    double x[4] = {}, P[4][4] = {};

    // Position and its covariance by detection d of a scan; the velocity is anything within about 20 m/s.
    void start(const Scan &scan, int64_t d = 0) {
        const bool radar = scan.components == 3;
        const double z[2] = {scan.measurement[d], scan.measurement[scan.detections + d]}, *R = scan.noise_covariance;
        const double angle = scan.sensor_pose[2] + (radar ? z[1] : 0.0), c = std::cos(angle), s = std::sin(angle);
        double along = R[0], across = R[3], cross = R[1], dx = z[0], dy = z[1];
        if (radar) {  // unbiased conversion of range and azimuth, Mo et al. (1998)
            const double var_r = R[0], var_a = R[4], loss = -0.5 * std::expm1(-2.0 * var_a);
            along = z[0] * z[0] * (std::expm1(var_a) - loss) + var_r * (1.0 - loss);
            across = (z[0] * z[0] + var_r) * loss;
            cross = 0.0;
            dx = z[0] / std::exp(-var_a / 2.0);
            dy = 0.0;
        }
        x[0] = scan.sensor_pose[0] + c * dx - s * dy;
        x[1] = scan.sensor_pose[1] + s * dx + c * dy;
        P[0][0] = c * c * along - 2.0 * c * s * cross + s * s * across;
        P[1][1] = s * s * along + 2.0 * c * s * cross + c * c * across;
        P[0][1] = P[1][0] = c * s * (along - across) + (c * c - s * s) * cross;
        P[2][2] = P[3][3] = 20.0 * 20.0;
    }

    // sigma: of the white acceleration, m/s^2.
    void predict(double dt, double sigma) {
        for (int i = 0; i < 2; i++) x[i] += dt * x[i + 2];
        for (int j = 0; j < 4; j++)
            for (int i = 0; i < 2; i++) P[i][j] += dt * P[i + 2][j];  // F P
        for (int i = 0; i < 4; i++)
            for (int j = 0; j < 2; j++) P[i][j] += dt * P[i][j + 2];  // F P F^T
        const double q = sigma * sigma * dt * dt;
        for (int i = 0; i < 2; i++) {
            P[i][i] += q * dt * dt / 4.0;
            P[i][i + 2] += q * dt / 2.0;
            P[i + 2][i] += q * dt / 2.0;
            P[i + 2][i + 2] += q;
        }
    }

    // What the sensor would measure of the state, and the Jacobian.
    void expect(const Scan &scan, double *z, double (*H)[4]) const {
        const double dx = x[0] - scan.sensor_pose[0], dy = x[1] - scan.sensor_pose[1];
        const double c = std::cos(scan.sensor_pose[2]), s = std::sin(scan.sensor_pose[2]);
        if (scan.components == 2) {  // a lidar: x and y in its frame
            z[0] = c * dx + s * dy;
            z[1] = c * dy - s * dx;
            H[0][0] = H[1][1] = c;
            H[0][1] = s;
            H[1][0] = -s;
            return;
        }
        const double r = std::max(std::hypot(dx, dy), 1e-6), ux = dx / r, uy = dy / r;
        const double vx = x[2] - scan.sensor_velocity[0], vy = x[3] - scan.sensor_velocity[1];
        const double turn = (ux * vy - uy * vx) / r;
        z[0] = r;
        z[1] = std::atan2(c * dy - s * dx, c * dx + s * dy);
        z[2] = ux * vx + uy * vy;
        const double rows[3][4] = { {ux, uy, 0, 0}, {-uy / r, ux / r, 0, 0}, {-uy * turn, ux * turn, ux, uy} };
        for (int k = 0; k < 3; k++)
            for (int j = 0; j < 4; j++) H[k][j] = rows[k][j];
    }

    // Take in the range rate of a radar's detection alone, which start() leaves out.
    void update_range_rate(const Scan &scan, int64_t d = 0) {
        if (scan.components != 3) return;
        double expected[3], H[3][4] = {}, PH[4] = {}, S = scan.noise_covariance[8];
        expect(scan, expected, H);
        for (int i = 0; i < 4; i++)
            for (int j = 0; j < 4; j++) PH[i] += P[i][j] * H[2][j];
        for (int i = 0; i < 4; i++) S += H[2][i] * PH[i];
        for (int i = 0; i < 4; i++) {
            x[i] += PH[i] / S * (scan.measurement[2 * scan.detections + d] - expected[2]);
            for (int j = 0; j < 4; j++) P[i][j] -= PH[i] * PH[j] / S;
        }
    }

    Innovation innovation(const Scan &scan, int64_t d = 0) const {
        const int m = static_cast<int>(scan.components);
        double expected[3], H[3][4] = {}, PH[4][3] = {}, L[3][3] = {};
        Innovation result;
        result.size = m;
        expect(scan, expected, H);
        for (int i = 0; i < 4; i++)
            for (int k = 0; k < m; k++)
                for (int j = 0; j < 4; j++) PH[i][k] += P[i][j] * H[k][j];
        for (int a = 0; a < m; a++)  // Cholesky of S = H P H^T + R
            for (int b = 0; b <= a; b++) {
                double sum = scan.noise_covariance[a * m + b];
                for (int j = 0; j < 4; j++) sum += H[a][j] * PH[j][b];
                for (int k = 0; k < b; k++) sum -= L[a][k] * L[b][k];
                L[a][b] = a == b ? std::sqrt(sum) : sum / L[b][b];
            }
        double *v = result.v;
        for (int k = 0; k < m; k++) {
            v[k] = scan.measurement[k * scan.detections + d] - expected[k];
            if (m == 3 && k == 1) v[k] = std::remainder(v[k], 2.0 * M_PI);
            for (int l = 0; l < k; l++) v[k] -= L[k][l] * v[l];
            v[k] /= L[k][k];
            result.squared += v[k] * v[k];
            result.log_determinant += 2.0 * std::log(L[k][k]);
            for (int i = 0; i < 4; i++) {
                result.W[i][k] = PH[i][k];
                for (int l = 0; l < k; l++) result.W[i][k] -= L[k][l] * result.W[i][l];
                result.W[i][k] /= L[k][k];
            }
        }
        return result;
    }

    void update(const Innovation &innovation) {
        const auto &W = innovation.W;
        for (int i = 0; i < 4; i++)
            for (int k = 0; k < innovation.size; k++) {
                x[i] += W[i][k] * innovation.v[k];
                for (int j = 0; j < 4; j++) P[i][j] -= W[i][k] * W[j][k];
            }
    }

    Estimate estimate() const {
        Estimate result;
        for (int i = 0; i < 4; i++) {
            result.mean[i] = x[i];
            for (int j = 0; j < 4; j++) result.covariance[4 * i + j] = 0.5 * (P[i][j] + P[j][i]);
        }
        return result;
    }
};

}  // namespace trackbench

#endif
