#include "WallMotion.h"

#include "NelderMead.h"
#include "TangentialHarmonics.h"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <map>
#include <stdexcept>

namespace rimflow {
namespace {

using Eigen::Matrix3d;
using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::VectorXd;

constexpr int Degree = 4, Modes = 2;
constexpr double Decay = 4;         // of the prior variances with the degree
constexpr double FirstDegree = 3;   // prior amplitude of degree 1 (Stokes flow) over what the decay gives
constexpr double ScaleStep = 0.8;   // of the average over the scales
constexpr double LeastNoise = 0.02; // of the scatter of the velocities
constexpr double Rejection = 5;     // standard deviations
constexpr double Flat = 100;        // width of the priors of V and omega R, in scatters of the velocity
using Harmonics = TangentialHarmonics<Degree>;

/// Where the unknowns stand; all have zero mean, the first nine unit variance. The wall's shear is followed
/// by the modes of its bending, Harmonics::Size each.
enum Unknown { Velocity = 0, Rotation = 3, Centre = 6, Shear = 9 };
constexpr int Unknowns = Shear + (1 + Modes) * Harmonics::Size;

struct Sample {
  Vector3d offset, velocity;
  std::int64_t track;
};

/// f(s), df/ds and the integral of (R + s) f from the wall.
struct Profile {
  double value, slope, moment;
};

/// Mode 0: f = s. Mode k: the k-th Karhunen-Loeve mode of a slope that walks randomly over the reach S
/// (Wiener process of unit intensity): df/ds = sqrt(2/S) sin(q s)/q, q = (k - 1/2) pi/S.
Profile profile(int mode, double s, double reach, double radius) {
  if (mode == 0) return {s, 1, s * s * (0.5 * radius + s / 3)};
  const double q = (mode - 0.5) * M_PI / reach, scale = std::sqrt(2 / reach) / (q * q);
  const double sine = std::sin(q * s), cosine = std::cos(q * s);
  const double first = s - sine / q, second = 0.5 * s * s - s * sine / q + (1 - cosine) / (q * q);
  return {scale * (1 - cosine), scale * q * sine, scale * (radius * first + second)};
}

/// L with L L^T = m, also for a singular m.
Matrix3d root(const Matrix3d& m) {
  const Eigen::SelfAdjointEigenSolver<Matrix3d> e(m);
  return e.eigenvectors() * e.eigenvalues().cwiseMax(0).cwiseSqrt().asDiagonal();
}

/// Logarithms of scales, each with a wide normal prior about what the velocities' scatter suggests.
struct LogScales {
  double shear = 0, bending = 0; ///< of a coefficient of degree 1: 1/s, and 1/(s sqrt(m))
  double white = 0;              ///< noise of each velocity, m/s
  double track = 0, model = 0;   ///< per track over white: a constant, and what grows with s, at the reach
};

struct Posterior {
  VectorXd mean;
  MatrixXd covariance; ///< of the first nine unknowns
};

class Fit {
public:
  Fit(const std::vector<Sample>& samples, const WallMotionOptions& o)
      : samples_(samples), o_(o), reach_(o.reach * o.radius), state_(VectorXd::Zero(Unknowns)) {
    for (const Sample& s : samples_) mean_ += s.velocity / double(samples_.size());
    for (const Sample& s : samples_) scatter_ += (s.velocity - mean_).squaredNorm();
    scatter_ = std::sqrt(scatter_ / (3.0 * double(samples_.size()))) + 1e-6 * mean_.norm() + 1e-12;
    centreRoot_ = root(o.centreCovariance);
    velocityRoot_ = o.velocityPrior ? root(o.velocityPrior->covariance)
                                    : Matrix3d(Flat * scatter_ * Matrix3d::Identity());
    if (o.velocityPrior) mean_ = o.velocityPrior->mean;
    numberTracks();
    typical_ = {std::log(2 * scatter_ / reach_), std::log(2 * scatter_ / std::pow(reach_, 1.5)),
                std::log(0.03 * scatter_), std::log(0.5), std::log(1.0)};
    scales_ = typical_;
  }

  int tracks() const { return tracks_; }

  /// The most probable scales, then the unknowns; the centre's error makes the problem slightly non-linear.
  void solve() {
    const int rounds = o_.centreCovariance.norm() > 0 ? 3 : 1;
    for (int k = 0; k < rounds; ++k) {
      linearise();
      findScales(k == 0 ? 1 : 0.3);
    }
  }

  /// What is not farther than a number of standard deviations from what all others predict for it: with the
  /// residual e, its noise v and the part S = X C X^T of the noise that the fit knows, e^T (v - S)^-1 e.
  std::vector<Sample> consistent(double limit) const {
    const VectorXd e = y_ - design_ * state_;
    const MatrixXd covariance = system(scales_).llt().solve(MatrixXd::Identity(Unknowns, Unknowns));
    const MatrixXd carried = design_ * covariance;
    const double white = noise(scales_), track = several_ ? std::exp(scales_.track) : 0;
    std::vector<Sample> kept;
    for (std::size_t i = 0; i < samples_.size(); ++i) {
      const double model = std::exp(scales_.model) * distance_[i];
      const double variance = white * white * (1 + model * model + track * track);
      const Matrix3d left = variance * Matrix3d::Identity() -
                            carried.middleRows<3>(3 * i) * design_.middleRows<3>(3 * i).transpose();
      const Vector3d own = e.segment<3>(3 * i);
      if (own.dot(left.ldlt().solve(own)) < limit * limit) kept.push_back(samples_[i]);
    }
    return kept;
  }

  WallMotion result() const {
    const auto carried = [&](const Matrix3d& l, int from) {
      return Matrix3d(l * covariance_.block<3, 3>(from, from) * l.transpose());
    };
    const Matrix3d rotationRoot = rotationUnit() * Matrix3d::Identity();
    WallMotion m;
    m.enough = true;
    m.velocity = mean_ + velocityRoot_ * state_.segment<3>(Velocity);
    m.velocityCovariance = carried(velocityRoot_, Velocity);
    m.angularVelocity = rotationRoot * state_.segment<3>(Rotation);
    m.angularVelocityCovariance = carried(rotationRoot, Rotation);
    m.centreCorrection = centreRoot_ * state_.segment<3>(Centre);
    m.particles = int(samples_.size());
    m.tracks = tracks_;
    m.residual = std::sqrt((y_ - design_ * state_).squaredNorm() / double(y_.size()));
    return m;
  }

private:
  double rotationUnit() const { return Flat * scatter_ / o_.radius; }
  double noise(const LogScales& l) const {
    return std::hypot(std::exp(l.white), std::max(o_.velocityNoise, LeastNoise * scatter_));
  }

  void numberTracks() {
    std::map<std::int64_t, int> numbers;
    for (const Sample& s : samples_) {
      if (s.track < 0) {
        trackOf_.push_back(tracks_++);
        continue;
      }
      const auto [at, fresh] = numbers.emplace(s.track, tracks_);
      if (fresh) ++tracks_;
      several_ = several_ || !fresh;
      trackOf_.push_back(at->second);
    }
  }

  /// y = X x + noise about the present state, and the sums that the solution needs.
  void linearise() {
    const Eigen::Index n = Eigen::Index(samples_.size());
    design_ = MatrixXd::Zero(3 * n, Unknowns);
    y_.resize(3 * n);
    distance_.resize(n);
    const Vector3d shift = centreRoot_ * state_.segment<3>(Centre);
    for (Eigen::Index i = 0; i < n; ++i) {
      const Vector3d r = samples_[i].offset - shift;
      const double length = r.norm(), s = length - o_.radius;
      const Vector3d direction = r / length;
      distance_[i] = std::max(s, 0.0) / reach_;
      auto rows = design_.middleRows<3>(3 * i);
      rows.middleCols<3>(Velocity) = velocityRoot_;
      Matrix3d cross; // cross * omega = omega x r
      cross << 0, r.z(), -r.y(), -r.z(), 0, r.x(), r.y(), -r.x(), 0;
      rows.middleCols<3>(Rotation) = rotationUnit() * cross;
      const Harmonics harmonics(direction);
      Vector3d slope = Vector3d::Zero(); // dw/ds
      for (int k = 0; k <= Modes; ++k) {
        const Profile f = profile(k, s, reach_, o_.radius);
        const int first = Shear + k * Harmonics::Size;
        const auto x = state_.segment<Harmonics::Size>(first);
        rows.middleCols<Harmonics::Size>(first) =
            f.value * harmonics.field -
            f.moment / (length * length) * direction * harmonics.divergence.transpose();
        slope +=
            f.slope * (harmonics.field * x) - f.value / o_.radius * harmonics.divergence.dot(x) * direction;
      }
      // u at the place seen from the centre + d is that at s - n . d.
      rows.middleCols<3>(Centre) = -slope * direction.transpose() * centreRoot_;
      y_.segment<3>(3 * i) =
          samples_[i].velocity - mean_ + rows.middleCols<3>(Centre) * state_.segment<3>(Centre);
    }
    gram_ = MatrixXd::Zero(Unknowns, Unknowns);
    gram_.selfadjointView<Eigen::Lower>().rankUpdate(design_.transpose());
    moment_ = design_.transpose() * y_;
    sumTracks();
  }

  /// Per track: numbers, and sums of rows times (1, distance).
  void sumTracks() {
    trackGram_.assign(tracks_, Eigen::Matrix2d::Zero());
    trackRows_ = MatrixXd::Zero(6 * tracks_, Unknowns);
    trackY_ = VectorXd::Zero(6 * tracks_);
    for (Eigen::Index i = 0; i < distance_.size(); ++i) {
      const int j = trackOf_[i];
      const Eigen::Vector2d z(1, distance_[i]);
      trackGram_[j] += z * z.transpose();
      for (int e = 0; e < 2; ++e) {
        trackRows_.middleRows<3>(6 * j + 3 * e) += z[e] * design_.middleRows<3>(3 * i);
        trackY_.segment<3>(6 * j + 3 * e) += z[e] * y_.segment<3>(3 * i);
      }
    }
  }

  /// Takes the tracks' own errors out of the sums. Per track and component the covariance over the white
  /// noise is I + Z D Z^T, its inverse I - Z (D^-1 + Z^T Z)^-1 Z^T (Woodbury). A single velocity cannot tell
  /// a track's constant from noise, so that is left out where no track comes twice.
  void reduce(const LogScales& scales) {
    const Eigen::Vector2d d(several_ ? std::exp(2 * scales.track) : 0, std::exp(2 * scales.model));
    const Eigen::Vector2d rootD = d.cwiseSqrt();
    const int effects = several_ ? 2 : 1;
    MatrixXd b(3 * effects * tracks_, Unknowns);
    VectorXd by(b.rows());
    reducedLogDeterminant_ = 0;
    for (int j = 0; j < tracks_; ++j) {
      // (D^-1 + Z^T Z)^-1 = D^1/2 (I + D^1/2 Z^T Z D^1/2)^-1 D^1/2
      const Eigen::Matrix2d m = Eigen::Matrix2d::Identity() +
                                Eigen::Matrix2d(rootD.asDiagonal() * trackGram_[j] * rootD.asDiagonal());
      reducedLogDeterminant_ += 3 * std::log(m.determinant());
      const Eigen::Matrix2d l =
          rootD.asDiagonal() * Eigen::Matrix2d(Eigen::Matrix2d(m.inverse()).llt().matrixL());
      for (int e = 0; e < effects; ++e) {
        const Eigen::Vector2d w = l.col(2 - effects + e);
        const int to = 3 * (effects * j + e), from = 6 * j;
        b.middleRows<3>(to) =
            w[0] * trackRows_.middleRows<3>(from) + w[1] * trackRows_.middleRows<3>(from + 3);
        by.segment<3>(to) = w[0] * trackY_.segment<3>(from) + w[1] * trackY_.segment<3>(from + 3);
      }
    }
    reducedGram_ = gram_;
    reducedGram_.selfadjointView<Eigen::Lower>().rankUpdate(b.transpose(), -1);
    reducedMoment_ = moment_ - b.transpose() * by;
    reducedSquare_ = y_.squaredNorm() - by.squaredNorm();
  }

  VectorXd priorVariances(const LogScales& l) const {
    VectorXd v = VectorXd::Ones(Unknowns);
    const std::vector<int> degrees = Harmonics::degrees();
    for (int k = 0; k <= Modes; ++k)
      for (int i = 0; i < Harmonics::Size; ++i)
        v[Shear + k * Harmonics::Size + i] =
            std::exp(2 * (k == 0 ? l.shear : l.bending)) *
            (degrees[i] == 1 ? FirstDegree * FirstDegree : std::pow(degrees[i], -Decay));
    return v;
  }

  /// A = X^T N^-1 X + P^-1 for the last reduce().
  MatrixXd system(const LogScales& l) const {
    MatrixXd a = reducedGram_ / std::pow(noise(l), 2);
    a.diagonal() += priorVariances(l).cwiseInverse();
    return a;
  }

  /// -log of the evidence times the priors of the scales, up to a constant, for the last reduce(). With
  /// b = X^T N^-1 y it is (y^T N^-1 y - b^T A^-1 b + log |N| + log |A| + log
  /// |P|)/2.
  double evidence(const LogScales& l, Posterior* posterior = nullptr) const {
    const double variance = std::pow(noise(l), 2);
    const VectorXd prior = priorVariances(l), b = reducedMoment_ / variance;
    const Eigen::LLT<MatrixXd> llt(system(l));
    const VectorXd x = llt.solve(b);
    if (posterior) {
      posterior->mean = x;
      posterior->covariance = llt.solve(MatrixXd::Identity(Unknowns, Shear)).topRows<Shear>();
    }
    const double logDeterminants = 2 * llt.matrixLLT().diagonal().array().log().sum() +
                                   prior.array().log().sum() + double(y_.size()) * std::log(variance) +
                                   reducedLogDeterminant_;
    const auto far = [](double value, double typical, double width) {
      return std::pow((value - typical) / width, 2);
    };
    return 0.5 * (reducedSquare_ / variance - b.dot(x) + logDeterminants + far(l.shear, typical_.shear, 1) +
                  far(l.bending, typical_.bending, 1) + far(l.white, typical_.white, 2) +
                  far(l.track, typical_.track, 2) + far(l.model, typical_.model, 2));
  }

  /// Mean and covariance over the scales of shear and bending, which few particles hardly determine: the
  /// posteriors on a grid about the most probable scales, each with its probability.
  void average() {
    std::vector<std::pair<double, Posterior>> list;
    for (int i = -1; i <= 1; ++i)
      for (int j = -1; j <= 1; ++j) {
        LogScales l = scales_;
        l.shear += i * ScaleStep, l.bending += j * ScaleStep;
        Posterior p;
        const double e = evidence(l, &p);
        list.emplace_back(e, std::move(p));
      }
    double lowest = list[0].first, sum = 0;
    for (const auto& [e, p] : list) lowest = std::min(lowest, e);
    for (auto& [e, p] : list) sum += e = std::exp(lowest - e);
    state_.setZero();
    covariance_ = MatrixXd::Zero(Shear, Shear);
    for (const auto& [weight, p] : list) state_ += weight / sum * p.mean;
    for (const auto& [weight, p] : list) {
      const VectorXd d = (p.mean - state_).head<Shear>();
      covariance_ += weight / sum * (p.covariance + d * d.transpose());
    }
  }

  /// The ratios outside, for each the others inside: these are cheap, and start where the last ones ended.
  void findScales(double step) {
    const auto inner = [&](double innerStep) {
      const auto with = [&](const VectorXd& v) {
        LogScales l = scales_;
        l.shear = v[0], l.bending = v[1], l.white = v[2];
        return l;
      };
      const VectorXd start = Vector3d(scales_.shear, scales_.bending, scales_.white);
      const VectorXd best = minimiseNelderMead([&](const VectorXd& v) { return evidence(with(v)); }, start,
                                               innerStep, 0.05, 60);
      scales_ = with(best);
    };
    const auto setRatios = [&](const VectorXd& v) {
      scales_.model = v[0];
      if (several_) scales_.track = v[1];
      reduce(scales_);
    };
    VectorXd ratios(several_ ? 2 : 1);
    ratios[0] = scales_.model;
    if (several_) ratios[1] = scales_.track;
    setRatios(ratios);
    inner(step);
    const auto profile = [&](const VectorXd& v) {
      setRatios(v);
      inner(0.2);
      return evidence(scales_);
    };
    ratios = minimiseNelderMead(profile, ratios, step, 0.1, several_ ? 14 : 8);
    setRatios(ratios);
    inner(0.2);
    average();
  }

  const std::vector<Sample>& samples_;
  const WallMotionOptions& o_;
  double reach_, scatter_ = 0;
  Vector3d mean_ = Vector3d::Zero(); // about which the velocities are taken
  Matrix3d centreRoot_, velocityRoot_;
  std::vector<int> trackOf_;
  int tracks_ = 0;
  bool several_ = false; // velocities of a track
  LogScales typical_, scales_;

  VectorXd state_;
  MatrixXd covariance_; // of the first nine
  MatrixXd design_, gram_, trackRows_;
  VectorXd y_, moment_, trackY_, distance_;
  std::vector<Eigen::Matrix2d> trackGram_;
  MatrixXd reducedGram_;
  VectorXd reducedMoment_;
  double reducedSquare_ = 0, reducedLogDeterminant_ = 0;
};

std::vector<Sample> nearTheWall(const std::vector<std::vector<WallParticle>>& snapshots,
                                const WallMotionOptions& o) {
  std::vector<Sample> samples;
  for (const auto& snapshot : snapshots)
    for (const WallParticle& p : snapshot) {
      const Vector3d offset = p.offset.cast<double>();
      if (p.velocity.allFinite() && std::abs(offset.norm() / o.radius - 1) < o.reach)
        samples.push_back({offset, p.velocity.cast<double>(), p.track});
    }
  return samples;
}

void check(const WallMotionOptions& o) {
  if (!(o.radius > 0)) throw std::invalid_argument("The sphere's radius must be greater than 0.");
  if (!(o.reach >= 0.05 && o.reach <= 1))
    throw std::invalid_argument("The reach must be 0.05 to 1 of the sphere's radius.");
  if (!(o.velocityNoise >= 0)) throw std::invalid_argument("The velocity noise must not be negative.");
}

} // namespace

WallMotion fitWallMotion(const std::vector<std::vector<WallParticle>>& snapshots,
                         const WallMotionOptions& o) {
  check(o);
  std::vector<Sample> samples = nearTheWall(snapshots, o);
  for (;;) {
    WallMotion few;
    if (samples.empty()) return few;
    Fit fit(samples, o);
    few.particles = int(samples.size());
    few.tracks = fit.tracks();
    if (few.tracks < std::max(o.minimumTracks, 4)) return few;
    fit.solve();
    std::vector<Sample> kept = fit.consistent(Rejection);
    if (kept.size() == samples.size()) return fit.result();
    samples = std::move(kept);
  }
}

} // namespace rimflow
