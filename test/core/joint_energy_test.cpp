#include "calligraphy_brush/rods/joint_energy.h"

#include <gtest/gtest.h>

#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>
#include <cmath>
#include <random>

using namespace calligraphy_brush;

namespace {

using Q = Quaternion<double>;

Q exponential(const Eigen::Vector3d& w) {
  const double angle = w.norm(), s = angle < 1e-12 ? 0.5 : std::sin(angle / 2) / angle;
  return {std::cos(angle / 2), s * w.x(), s * w.y(), s * w.z()};
}

Q positive(Q q) {
  return q.w < 0 ? Q{-q.w, -q.x, -q.y, -q.z} : q;
}

double energy(const Q& q0, const Q& q1, const Joint<double>& joint, const Eigen::Vector3d& w0,
              const Eigen::Vector3d& w1, double round) {
  return jointEnergy(positive((q0 * exponential(w0)).conjugate() * (q1 * exponential(w1))), joint,
                     round);
}

struct Case {
  Q q0, q1;
  Joint<double> joint;
};

Case randomCase(std::mt19937& random, double bend, double scale) {
  std::normal_distribution<double> normal;
  const auto vector = [&] { return Eigen::Vector3d(normal(random), normal(random), normal(random)); };
  const auto stiffness = [&] { return scale * std::exp(normal(random)); };
  Case c;
  c.q0 = exponential(vector());
  c.q1 = c.q0 * exponential(bend * vector());
  c.joint = {stiffness(),
             stiffness(),
             stiffness(),
             0.3 * bend * normal(random),
             0.3 * bend * normal(random),
             0.3 * bend * normal(random)};
  return c;
}

}  // namespace

TEST(ArcTangent, IsThatOfTheLibrary) {
  for (double angle = -1.57; angle <= 1.57; angle += 0.0137)
    for (const double size : {1e-8, 1.0, 1e6})
      EXPECT_NEAR(arcTangent(size * std::sin(angle), size * std::cos(angle)), angle, 4e-16);
  EXPECT_EQ(arcTangent(0.0, 1.0), 0.0);
  EXPECT_NEAR(arcTangent(1.0, 0.0), 1.5707963267948966, 1e-15);
}

TEST(JointStrain, IsThatOfDiscreteElasticRods) {
  std::mt19937 random(1);
  for (int k = 0; k < 50; ++k) {
    const Case c = randomCase(random, 0.4, 1.0);
    Vec3<double> a1, a2, at, b1, b2, bt;
    axes(c.q0, a1, a2, at);
    axes(c.q1, b1, b2, bt);
    const JointStrain<double> strain = jointStrain(positive(c.q0.conjugate() * c.q1), 0.0);
    const double cosine = dot(at, bt);
    EXPECT_NEAR(std::hypot(strain.bend1, strain.bend2), 2 * std::tan(std::acos(cosine) / 2), 1e-7);
    // Twist: carry the first edge's directors along to the second, then measure the angle.
    const Eigen::Vector3d t0(at.x, at.y, at.z), t1(bt.x, bt.y, bt.z), d0(a1.x, a1.y, a1.z),
        d1(b1.x, b1.y, b1.z);
    const Eigen::Vector3d carried = Eigen::Quaterniond::FromTwoVectors(t0, t1) * d0;
    EXPECT_NEAR(strain.twist, std::atan2(carried.cross(d1).dot(t1), carried.dot(d1)), 1e-9);
  }
}

TEST(JointEnergy, GradientIsItsDerivative) {
  std::mt19937 random(2);
  for (const double scale : {1e-8, 1.0, 1e8})
    for (const double bend : {0.01, 0.2, 0.8})
      for (int k = 0; k < 20; ++k) {
        const double round = 0.05 * k;  // from 2 tan to 2 sin
        const Case c = randomCase(random, bend, scale);
        JointDerivatives<double> d;
        jointDerivatives(positive(c.q0.conjugate() * c.q1), c.joint, round, 0.0, d);
        const double h = 1e-5;
        for (int i = 0; i < 3; ++i) {
          const Eigen::Vector3d e = h * Eigen::Vector3d::Unit(i), o = Eigen::Vector3d::Zero();
          EXPECT_NEAR(
              d.gradient0[i],
              (energy(c.q0, c.q1, c.joint, e, o, round) - energy(c.q0, c.q1, c.joint, -e, o, round)) /
                  (2 * h),
              2e-7 * scale);
          EXPECT_NEAR(
              d.gradient1[i],
              (energy(c.q0, c.q1, c.joint, o, e, round) - energy(c.q0, c.q1, c.joint, o, -e, round)) /
                  (2 * h),
              2e-7 * scale);
        }
      }
}

TEST(JointEnergy, HessianIsItsSecondDerivativeAndSymmetric) {
  std::mt19937 random(3);
  for (const double scale : {1e-8, 1.0, 1e8})
    for (const double bend : {0.01, 0.2, 0.8})
      for (int k = 0; k < 20; ++k) {
        const double round = 0.05 * k;  // from 2 tan to 2 sin
        const Case c = randomCase(random, bend, scale);
        JointDerivatives<double> d;
        jointDerivatives(positive(c.q0.conjugate() * c.q1), c.joint, round, 0.0, d);
        // Second differences of the energy along every pair of directions of (ω₀, ω₁).
        const double h = 2e-4;
        const auto at = [&](const Eigen::Matrix<double, 6, 1>& w) {
          return energy(c.q0, c.q1, c.joint, w.head<3>(), w.tail<3>(), round);
        };
        for (int i = 0; i < 6; ++i)
          for (int j = 0; j < 6; ++j) {
            const Eigen::Matrix<double, 6, 1> a = h * Eigen::Matrix<double, 6, 1>::Unit(i),
                                              b = h * Eigen::Matrix<double, 6, 1>::Unit(j);
            const double difference = (at(a + b) - at(a - b) - at(b - a) + at(-a - b)) / (4 * h * h);
            const double ours = i < 3 ? (j < 3 ? d.hessian00[i][j] : d.hessian01[i][j - 3])
                                      : (j < 3 ? d.hessian01[j][i - 3] : d.hessian11[i - 3][j - 3]);
            // exp() of a sum of two turns of one frame is symmetric in them, as the blocks are.
            EXPECT_NEAR(ours, difference, 3e-5 * scale) << i << " " << j;
          }
      }
}

TEST(JointEnergy, DoesNotSeeACommonTurn) {
  std::mt19937 random(4);
  const Case c = randomCase(random, 0.5, 1.0);
  const Q turn = exponential({0.3, -1.2, 0.7});
  EXPECT_NEAR(jointEnergy(positive((turn * c.q0).conjugate() * (turn * c.q1)), c.joint, 0.3),
              jointEnergy(positive(c.q0.conjugate() * c.q1), c.joint, 0.3), 1e-14);
}

TEST(JointEnergy, ConvexPartIsPositive) {
  std::mt19937 random(5);
  for (int k = 0; k < 200; ++k) {
    const Case c = randomCase(random, 1.0, 1.0);
    JointDerivatives<double> d;
    jointDerivatives(positive(c.q0.conjugate() * c.q1), c.joint, 0.5, 1.0, d);
    Eigen::Matrix<double, 6, 6> H;
    for (int i = 0; i < 3; ++i)
      for (int j = 0; j < 3; ++j) {
        H(i, j) = d.hessian00[i][j];
        H(i, j + 3) = d.hessian01[i][j];
        H(j + 3, i) = d.hessian01[i][j];
        H(i + 3, j + 3) = d.hessian11[i][j];
      }
    const Eigen::SelfAdjointEigenSolver<Eigen::Matrix<double, 6, 6>> solver(H);
    EXPECT_GT(solver.eigenvalues()[0], -1e-10 * solver.eigenvalues()[5]);
  }
}
