#include "FlowAroundSphere.h"

#include "TangentialHarmonics.h"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <limits>
#include <array>
#include <cstdio>
#include <map>
#include <stdexcept>

namespace rimflow {
namespace {

using Eigen::Matrix3d;
using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::VectorXd;

double env(const char* n, double d) { return getenv(n) ? atof(getenv(n)) : d; }

/// Divergence-free velocities that vanish on the unit sphere, columns of out (3 x orders * Size): tangential
/// xi^(k+1) times the vector harmonics, xi = r - 1, and what continuity then makes of the normal component.
template <int Degree, class Columns>
void noSlipModes(const Vector3d& r, const double* layers, int orders, Columns&& out) {
  using Harmonics = TangentialHarmonics<Degree>;
  const double length = r.norm(), xi = length - 1;
  const Vector3d n = r / length;
  const Harmonics h(n);
  for (int k = 0; k < orders; ++k) {
    const double d = layers[k];
    const double e = std::exp(-xi / d), f = d * (1 - e);
    // integral of r f from the wall
    const double moment = d * (xi + 0.5 * xi * xi - d * (1 - e) - d * d + e * d * (xi + d));
    out.template middleCols<Harmonics::Size>(k * Harmonics::Size) =
        f * h.field - moment / (length * length) * n * h.divergence.transpose();
  }
}

/// cross * a = a x r
Matrix3d crossWith(const Vector3d& r) {
  Matrix3d m;
  m << 0, r.z(), -r.y(), -r.z(), 0, r.x(), r.y(), -r.x(), 0;
  return m;
}

// ---------------------------------------------------------------------------------------------- the fit

#ifndef FD
#define FD 4
#endif
constexpr int FitDegree = FD;
using FitHarmonics = TangentialHarmonics<FitDegree>;
constexpr int Centre = 0, Velocity = 3, Rotation = 6, Flow = 9;
constexpr int Bins = 4;
const double Layers[3] = {env("D0", 0.1), env("D1", 0.3), env("D2", 1)};

/// A mean velocity on a short piece of a track, in units of R and U.
struct Sample {
  Vector3d offset = Vector3d::Zero(), velocity = Vector3d::Zero();
  double time = 0;
  int track = 0, count = 0;
};

class Fit {
public:
  Fit(const std::vector<FlowView>& views, const FlowFitOptions& o, double reach, int orders) : o_(o), reach_(reach), orders_(orders) {
    time_ = 0.5 * (views.front().time + views.back().time);
    half_ = std::max(0.5 * (views.back().time - views.front().time), 1e-12);
    collect(views);
    unknowns_ = Flow + orders_ * FitHarmonics::Size;
    state_ = VectorXd::Zero(unknowns_);
  }
  int tracks() const { return tracks_; }
  void solve() {
    bandVariance_.assign(Bins, 0.01);
    amplitude_.assign(orders_, 0);
    for (int k = 0; k < orders_; ++k) amplitude_[k] = 4;
    weights_.assign(samples_.size(), 1);
    const int rounds = int(env("ROUNDS", 6));
    for (int round = 0; round < rounds; ++round) {
      linearise();
      const Vector3d before = state_.segment<3>(Centre);
      for (int k = 0; k < (round == 0 ? 8 : 4); ++k) regress();
      Vector3d step = state_.segment<3>(Centre) - before;
      if (step.norm() > 0.06) state_.segment<3>(Centre) = before + step * (0.06 / step.norm());
      if (round > 1 && step.norm() < 2e-4) break;
    }
  }
  FlowFit result() const {
    FlowFit f;
    f.enough = true;
    f.time = time_;
    f.tracks = tracks_;
    f.samples = int(samples_.size());
    f.centre = o_.radius * state_.segment<3>(Centre);
    f.velocity = speed_ * state_.segment<3>(Velocity);
    f.angularVelocity = speed_ / o_.radius * state_.segment<3>(Rotation);
    VectorXd unit(6);
    unit << Vector3d::Constant(o_.radius), Vector3d::Constant(speed_);
    f.covariance = unit.asDiagonal() * covariance_.topLeftCorner<6, 6>() * unit.asDiagonal();
    f.angularVelocityCovariance = std::pow(speed_ / o_.radius, 2) * covariance_.block<3, 3>(Rotation, Rotation);
    f.noise = speed_ * std::sqrt(bandVariance_[0]);
    if (getenv("VERB")) {
      printf("   bins");
      for (int b = 0; b < Bins; ++b) printf(" %.4f", std::sqrt(bandVariance_[b]));
      printf(" amp");
      for (double a : amplitude_) printf(" %.3g", std::sqrt(a));
      printf(" U %.3f samples %zu tracks %d\n", speed_, samples_.size(), tracks_);
    }
    return f;
  }

private:
  void collect(const std::vector<FlowView>& views) {
    const double outer = (1 + reach_) , inner = 0.85;
    std::map<std::int64_t, std::vector<Sample>> byTrack;
    std::int64_t unknown = -1;
    double squares = 0;
    std::size_t n = 0;
    for (const FlowView& v : views)
      for (const WallParticle& p : v.particles) {
        Sample s;
        s.offset = p.offset.cast<double>() / o_.radius;
        const double r = s.offset.norm();
        if (!(r < outer && r > inner) || !p.velocity.allFinite()) continue;
        s.velocity = p.velocity.cast<double>() - v.velocity;
        s.time = (v.time - time_) / half_;
        s.count = 1;
        squares += s.velocity.squaredNorm();
        ++n;
        std::vector<Sample>& track = byTrack[p.track >= 0 ? p.track : unknown--];
        // Goes to the present piece of its track, or starts a new one.
        if (!track.empty() && (s.offset - track.back().offset / track.back().count).norm() < 0.15) {
          Sample& piece = track.back();
          piece.offset += s.offset;
          piece.velocity += s.velocity;
          piece.time += s.time;
          ++piece.count;
        } else
          track.push_back(s);
      }
    speed_ = std::sqrt(squares / std::max<std::size_t>(n, 1)) + 1e-12;
    std::size_t pieces = 0;
    for (const auto& t : byTrack) pieces += t.second.size();
    const double share = std::min(1., o_.samples / double(std::max<std::size_t>(pieces, 1)));
    double owed = 0.5;
    for (const auto& [id, list] : byTrack) {
      owed += share;
      if (owed < 1) continue;
      owed -= 1;
      for (Sample s : list) {
        s.offset /= s.count;
        s.velocity /= s.count * speed_;
        s.time /= s.count;
        s.track = tracks_;
        samples_.push_back(s);
      }
      ++tracks_;
    }
  }
  /// The model's velocity and its gradient at r.
  Matrix3d gradient(const Vector3d& r, MatrixXd& modes) const {
    const auto c = state_.tail(unknowns_ - Flow);
    Matrix3d g;
    const double h = 1e-4;
    for (int a = 0; a < 3; ++a) {
      noSlipModes<FitDegree>(r + h * Vector3d::Unit(a), Layers, orders_, modes);
      g.col(a) = modes * c;
      noSlipModes<FitDegree>(r - h * Vector3d::Unit(a), Layers, orders_, modes);
      g.col(a) = (g.col(a) - modes * c) / (2 * h);
    }
    const Vector3d w = state_.segment<3>(Rotation);
    return g + (Matrix3d() << 0, -w.z(), w.y(), w.z(), 0, -w.x(), -w.y(), w.x(), 0).finished();
  }
  void linearise() {
    const Eigen::Index n = Eigen::Index(samples_.size());
    const double drift = speed_ * half_ / o_.radius; // of the path in units of R per unit of velocity
    MatrixXd modes(3, orders_ * FitHarmonics::Size), design(3 * n, unknowns_);
    VectorXd y(3 * n);
    std::vector<int> bin(n);
    std::vector<double> xi(n);
    for (Eigen::Index i = 0; i < n; ++i) {
      const Sample& s = samples_[i];
      const Vector3d r = s.offset - state_.segment<3>(Centre) - drift * s.time * state_.segment<3>(Velocity);
      const Matrix3d g = gradient(r, modes);
      noSlipModes<FitDegree>(r, Layers, orders_, modes);
      auto rows = design.middleRows<3>(3 * i);
      rows.middleCols<3>(Centre) = -g;
      rows.middleCols<3>(Velocity) = Matrix3d::Identity() - drift * s.time * g;
      rows.middleCols<3>(Rotation) = crossWith(r);
      rows.rightCols(unknowns_ - Flow) = modes;
      const Vector3d model = state_.segment<3>(Velocity) + rows.middleCols<3>(Rotation) * state_.segment<3>(Rotation) +
                             modes * state_.tail(unknowns_ - Flow);
      const Vector3d residual = s.velocity - model;
      y.segment<3>(3 * i) = residual + rows * state_;
      xi[i] = r.norm() - 1;
      bin[i] = std::min(Bins - 1, std::max(0, int(Bins * xi[i] / reach_)));
      const double nu = 4;
      weights_[i] = any_ ? (nu + 3) / (nu + residual.squaredNorm() / bandVariance_[bin[i]]) : 1;
    }
    any_ = true;
    const std::vector<int> pieces = [&] { std::vector<int> c(tracks_); for (auto& s : samples_) ++c[s.track]; return c; }();
    for (int b = 0; b < Bins; ++b) {
      std::vector<Eigen::Index> mine;
      for (Eigen::Index i = 0; i < n; ++i)
        if (bin[i] == b) mine.push_back(i);
      MatrixXd x(3 * mine.size(), unknowns_);
      VectorXd z(3 * mine.size());
      count_[b] = 0;
      for (std::size_t j = 0; j < mine.size(); ++j) {
        double w = weights_[mine[j]] / std::pow(pieces[samples_[mine[j]].track], env("PIECE", 0));
        count_[b] += 3 * w;
        w = std::sqrt(w);
        x.middleRows<3>(3 * j) = w * design.middleRows<3>(3 * mine[j]);
        z.segment<3>(3 * j) = w * y.segment<3>(3 * mine[j]);
      }
      gram_[b] = MatrixXd::Zero(unknowns_, unknowns_);
      gram_[b].selfadjointView<Eigen::Lower>().rankUpdate(x.transpose());
      gram_[b].triangularView<Eigen::StrictlyUpper>() = gram_[b].transpose();
      moment_[b] = x.transpose() * z;
      square_[b] = z.squaredNorm();
    }
  }
  void regress() {
    VectorXd prior(unknowns_);
    const double c = o_.centrePrior > 0 ? o_.centrePrior / o_.radius : 0.2;
    const double v = o_.velocityPrior > 0 ? o_.velocityPrior / speed_ : 0.2;
    prior.segment<3>(Centre).setConstant(c * c);
    prior.segment<3>(Velocity).setConstant(v * v);
    prior.segment<3>(Rotation).setConstant(0.3 * 0.3);
    const std::vector<int> degrees = FitHarmonics::degrees();
    const double fall = env("FALL", 4);
    VectorXd shape(unknowns_ - Flow);
    for (int k = 0; k < orders_; ++k)
      for (int i = 0; i < FitHarmonics::Size; ++i) {
        shape[k * FitHarmonics::Size + i] = std::pow(degrees[i], -fall);
        prior[Flow + k * FitHarmonics::Size + i] = amplitude_[k] * shape[k * FitHarmonics::Size + i];
      }
    MatrixXd a = MatrixXd::Zero(unknowns_, unknowns_);
    VectorXd b = VectorXd::Zero(unknowns_);
    for (int k = 0; k < Bins; ++k) {
      a += gram_[k] / bandVariance_[k];
      b += moment_[k] / bandVariance_[k];
    }
    a.diagonal() += prior.cwiseInverse();
    covariance_ = a.llt().solve(MatrixXd::Identity(unknowns_, unknowns_));
    state_ = covariance_ * b;
    // MacKay (1992): the most probable variances, each against the degrees of freedom that the data leave it.
    for (int k = 0; k < Bins; ++k) {
      const double squares = square_[k] - 2 * state_.dot(moment_[k]) + state_.dot(gram_[k] * state_);
      const double used = covariance_.cwiseProduct(gram_[k]).sum() / bandVariance_[k];
      const double nu = 6, typical = bandVariance_[k];
      bandVariance_[k] = std::max(1e-6, (std::max(squares, 0.) + nu * typical) / (std::max(count_[k] - used, 0.) + nu));
    }
    for (int k = 0; k < orders_; ++k) {
      const int from = Flow + k * FitHarmonics::Size, n = FitHarmonics::Size;
      const VectorXd q = shape.segment(k * n, n);
      const double squares = (state_.segment(from, n).cwiseAbs2() + covariance_.diagonal().segment(from, n)).cwiseQuotient(q).sum();
      amplitude_[k] = squares / n;
    }
  }

  const FlowFitOptions& o_;
  double reach_;
  int orders_, unknowns_ = 0, tracks_ = 0;
  double time_ = 0, half_ = 1, speed_ = 1;
  std::vector<Sample> samples_;
  VectorXd state_;
  MatrixXd covariance_;
  std::vector<double> bandVariance_, amplitude_, weights_;
  bool any_ = false;
  std::array<MatrixXd, Bins> gram_;
  std::array<VectorXd, Bins> moment_;
  std::array<double, Bins> square_, count_;
};

// ----------------------------------------------------------------------------------------- the evidence

/// Log of the probability of y ~ N(v, sigma2 (I + snr K)), sigma (prior 1/sigma) and the uniform velocity v
/// (flat prior) integrated out; up to a constant that depends on the number of data alone.
double logEvidence(const MatrixXd& k, double snr, const VectorXd& y) {
  const Eigen::Index rows = y.size();
  MatrixXd s = snr * k;
  s.diagonal().array() += 1;
  const Eigen::LLT<MatrixXd> llt(s);
  MatrixXd x(rows, 4); // the uniform velocities, and y; all over the root of the covariance
  for (Eigen::Index i = 0; i < rows; i += 3) x.block<3, 3>(i, 0).setIdentity();
  x.col(3) = y;
  llt.matrixL().solveInPlace(x);
  const Matrix3d g = x.leftCols<3>().transpose() * x.leftCols<3>();
  const Vector3d b = x.leftCols<3>().transpose() * x.col(3);
  const double squares = x.col(3).squaredNorm() - b.dot(g.ldlt().solve(b));
  return -llt.matrixLLT().diagonal().array().log().sum() - 0.5 * std::log(g.determinant()) -
         0.5 * double(rows - 3) * std::log(std::max(squares, 1e-300));
}

/// Of the models, as they come: the log of the mean probability, and the best.
struct ModelAverage {
  double best = -std::numeric_limits<double>::infinity(), sum = 0; // sum of exp(log - best)
  int models = 0;
  /// True when it is the best so far.
  bool add(double log) {
    ++models;
    if (log <= best) {
      sum += std::exp(log - best);
      return false;
    }
    sum = sum * std::exp(best - log) + 1;
    best = log;
    return true;
  }
  double log() const { return best + std::log(sum / models); }
};

/// Covariance of an isotropic divergence-free velocity of unit variance and correlation length `length`:
/// the curl of a vector potential with covariance exp(-r2/2 length2).
MatrixXd smoothFlow(const std::vector<Vector3d>& x, double length) {
  const Eigen::Index n = Eigen::Index(x.size());
  MatrixXd k(3 * n, 3 * n);
  for (Eigen::Index i = 0; i < n; ++i)
    for (Eigen::Index j = 0; j <= i; ++j) {
      const Vector3d r = (x[i] - x[j]) / length;
      const Matrix3d m = 0.5 * std::exp(-0.5 * r.squaredNorm()) *
                         ((2 - r.squaredNorm()) * Matrix3d::Identity() + r * r.transpose());
      k.block<3, 3>(3 * i, 3 * j) = m;
      k.block<3, 3>(3 * j, 3 * i) = m;
    }
  return k;
}

/// Keeps `count` of them, evenly along the list (which follows the index's cells), and returns the velocities.
VectorXd thinOut(std::vector<Vector3d>& x, const std::vector<Vector3d>& u, int count) {
  const std::size_t n = x.size(), keep = std::min<std::size_t>(n, count);
  VectorXd y(3 * keep);
  for (std::size_t i = 0; i < keep; ++i) {
    const std::size_t from = i * n / keep;
    x[i] = x[from];
    y.segment<3>(3 * i) = u[from];
  }
  x.resize(keep);
  return y;
}

constexpr double SignalToNoise[] = {1e-2, 1, 10, 100, 1e3, 1e4, 1e5}; // variances
constexpr double Hopeless = -80; // log Bayes factor that no shift of the centre makes up for
constexpr double NearestToCentre = 0.97;                              // R; nearer tracers would be ghosts
constexpr int EvidenceDegree = 3;
/// The same of the flow around a body with a boundary layer of this thickness (R), relative to the body.
MatrixXd flowAroundBody(const std::vector<Vector3d>& x, const Vector3d& centre, double thickness) {
  using Harmonics = TangentialHarmonics<EvidenceDegree>;
  const Eigen::Index n = Eigen::Index(x.size());
  MatrixXd m(3 * n, 3 + 2 * Harmonics::Size);
  const double layers[2] = {thickness, 3 * thickness};
  for (Eigen::Index i = 0; i < n; ++i) {
    const Vector3d r = x[i] - centre;
    m.block<3, 3>(3 * i, 0) = 0.3 * crossWith(r);
    noSlipModes<EvidenceDegree>(r, layers, 2, m.block(3 * i, 3, 3, 2 * Harmonics::Size));
  }
  const std::vector<int> degrees = Harmonics::degrees();
  for (int k = 0; k < 2; ++k)
    for (int i = 0; i < Harmonics::Size; ++i)
      m.col(3 + k * Harmonics::Size + i) *= 1 / layers[k] / std::pow(degrees[i], 2);
  MatrixXd k = MatrixXd::Zero(3 * n, 3 * n);
  k.selfadjointView<Eigen::Lower>().rankUpdate(m);
  return k;
}

} // namespace

FlowFit fitFlow(const std::vector<FlowView>& views, const FlowFitOptions& options) {
  if (!(options.radius > 0)) throw std::invalid_argument("The sphere's radius must be greater than 0.");
  if (views.empty()) return {};
  Fit fit(views, options, options.reach, int(env("ORDERS", 3)));
  if (fit.tracks() < options.minimumTracks) {
    FlowFit few;
    few.tracks = fit.tracks();
    return few;
  }
  fit.solve();
  return fit.result();
}

FlowEvidence flowEvidence(const std::vector<WallParticle>& particles, const FlowEvidenceOptions& options) {
  if (!(options.radius > 0)) throw std::invalid_argument("The sphere's radius must be greater than 0.");
  std::vector<Vector3d> x, u;
  for (const WallParticle& p : particles) {
    const Vector3d r = p.offset.cast<double>() / options.radius;
    if (!(r.norm() > NearestToCentre && r.norm() < 1 + options.reach) || !p.velocity.allFinite()) continue;
    x.push_back(r);
    u.push_back(p.velocity.cast<double>());
  }
  FlowEvidence result;
  result.particles = int(x.size());
  if (result.particles < options.minimumParticles) return result;
  const VectorXd y = thinOut(x, u, options.samples);

  ModelAverage fluid, body;
  for (double length : {0.5, 1., 2., 4., 8.}) {
    const MatrixXd k = smoothFlow(x, length);
    for (double snr : SignalToNoise) fluid.add(logEvidence(k, snr, y));
  }
  double thickness = 0, snr = 0;
  for (double t : {0.1, 0.3, 1.}) {
    const MatrixXd k = flowAroundBody(x, Vector3d::Zero(), t);
    for (double s : SignalToNoise)
      if (body.add(logEvidence(k, s, y))) thickness = t, snr = s;
  }
  // The place is known to some R/10 only: climb, and count every place looked at as a model as probable as
  // the first, all its scales together.
  if (body.log() - fluid.log() < Hopeless) {
    result.logBayesFactor = body.log() - fluid.log();
    return result;
  }
  const int scales = body.models;
  double top = body.best;
  Vector3d at = Vector3d::Zero();
  for (double step = 0.12; step > 0.05; step *= 0.5)
    for (bool moved = true; moved;) {
      moved = false;
      for (int a = 0; a < 6; ++a) {
        const Vector3d c = at + (a % 2 ? -step : step) * Vector3d::Unit(a / 2);
        if (c.norm() > options.centreError) continue;
        const double e = logEvidence(flowAroundBody(x, c, thickness), snr, y);
        body.add(e);
        body.models += scales - 1;
        if (e > top) {
          top = e;
          at = c;
          moved = true;
          break;
        }
      }
    }
  result.logBayesFactor = body.log() - fluid.log();
  result.centre = options.radius * at;
  return result;
}

} // namespace rimflow
