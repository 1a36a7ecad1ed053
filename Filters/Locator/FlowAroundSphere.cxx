#include "FlowAroundSphere.h"

#include "TangentialHarmonics.h"

#include <Eigen/Cholesky>
#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <map>
#include <stdexcept>

namespace rimflow {
namespace {

using Eigen::Matrix3d;
using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::VectorXd;

/// Divergence-free velocities at r that vanish on the unit sphere, columns of out (3 x count * Size): with
/// s = |r| - 1, tangential f(s) = d (1 - exp(-s/d)) times the vector harmonics for each layer thickness d,
/// and normal -1/r2 integral of (1 + s) f ds times their divergence (continuity).
template <int Degree, class Columns>
void noSlipModes(const Vector3d& r, const double* layers, int count, Columns&& out) {
  using Harmonics = TangentialHarmonics<Degree>;
  const double length = r.norm(), s = length - 1;
  const Vector3d n = r / length;
  const Harmonics h(n);
  for (int k = 0; k < count; ++k) {
    const double d = layers[k];
    const double e = std::exp(-s / d), f = d * (1 - e);
    const double moment = d * (s + 0.5 * s * s - d * (1 - e) - d * d + e * d * (s + d));
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

void check(double radius, double reach) {
  if (!(radius > 0)) throw std::invalid_argument("The sphere's radius must be greater than 0.");
  if (!(reach >= 0.1 && reach <= 2))
    throw std::invalid_argument("The reach must be 0.1 to 2 of the sphere's radius.");
}

constexpr int FitDegree = 4, Layers = 3;
using FitHarmonics = TangentialHarmonics<FitDegree>;
constexpr double LayerThickness[Layers] = {0.1, 0.3, 1}; // R; together they make any boundary layer
constexpr double PieceLength = 0.15, Innermost = 0.85;   // R
constexpr double LargestStep = 0.06;                     // of the centre per round, R
constexpr double FewTracks = 60;     // do not determine the scales of flow and noise: measured, see the docs
constexpr double LeastSigma = 0.001; // of any component of the answer, R, U or U/R
constexpr int Bands = 4;             // of the distance from the wall, each with its noise

/// Where the unknowns stand; lengths over R, velocities over U, accelerations over U per half of the time
/// span.
enum Unknown { Centre = 0, Velocity = 3, Acceleration = 6, Rotation = 9, Flow = 12 };
constexpr int Unknowns = Flow + Layers * FitHarmonics::Size;

/// The mean over a short piece of a track.
struct Sample {
  Vector3d offset = Vector3d::Zero(), velocity = Vector3d::Zero();
  double time = 0; // from the middle, half the span is 1
  int count = 0;
  double share = 1; // 1 over the pieces of its track: a track counts once
};

/// The data of a fit, whatever its options.
struct Tracks {
  std::vector<std::vector<Sample>> pieces; // per track
  double time = 0, halfSpan = 1, speed = 0;
};

/// How the flow around the body has grown and turned in a view, against the mean: with the body's velocity,
/// when it moves in fluid at rest. Not at all where the body hardly moves: then it is the fluid that flows
/// past it.
struct Change {
  double growth = 1;
  Matrix3d back = Matrix3d::Identity(); // turns the view's velocity into the mean one's direction
};
std::vector<Change> changes(const std::vector<FlowView>& views) {
  Vector3d mean = Vector3d::Zero();
  double squares = 0, n = 1e-12;
  for (const FlowView& view : views) mean += view.velocity / double(views.size());
  for (const FlowView& view : views)
    for (const WallParticle& p : view.particles)
      if (p.velocity.allFinite()) squares += (p.velocity.cast<double>() - mean).squaredNorm(), ++n;
  std::vector<Change> changes(views.size());
  if (mean.squaredNorm() < 0.6 * squares / n) return changes;
  for (std::size_t k = 0; k < views.size(); ++k) {
    const Vector3d& v = views[k].velocity;
    changes[k].growth = std::clamp(v.norm() / mean.norm(), 0.5, 2.);
    if (v.dot(mean) > 0.5 * v.norm() * mean.norm())
      changes[k].back = Eigen::Quaterniond::FromTwoVectors(v, mean).toRotationMatrix();
  }
  return changes;
}

Tracks collect(const std::vector<FlowView>& views, const FlowFitOptions& o) {
  Tracks t;
  t.time = 0.5 * (views.front().time + views.back().time);
  t.halfSpan = std::max(0.5 * (views.back().time - views.front().time), 1e-12);
  std::map<std::int64_t, std::vector<Sample>> byTrack;
  std::int64_t unknown = -1;
  double squares = 0, n = 0;
  const std::vector<Change> change = changes(views);
  for (std::size_t k = 0; k < views.size(); ++k)
    for (const WallParticle& p : views[k].particles) {
      const FlowView& view = views[k];
      const Vector3d x = change[k].back * p.offset.cast<double>() / o.radius;
      const Vector3d u = change[k].back * (p.velocity.cast<double>() - view.velocity) / change[k].growth;
      if (!(x.norm() < 1 + 1.3 * o.reach && x.norm() > Innermost) || !u.allFinite()) continue;
      squares += u.squaredNorm();
      ++n;
      std::vector<Sample>& track = byTrack[p.track >= 0 ? p.track : unknown--];
      if (track.empty() || (x - track.back().offset / track.back().count).norm() > PieceLength)
        track.emplace_back();
      Sample& piece = track.back();
      piece.offset += x;
      piece.velocity += u;
      piece.time += (view.time - t.time) / t.halfSpan;
      ++piece.count;
    }
  t.speed = std::sqrt(squares / std::max(n, 1.)) + 1e-12;
  std::size_t pieces = 0;
  for (const auto& track : byTrack) pieces += track.second.size();
  const double keep = std::min(1., o.samples / std::max(double(pieces), 1.));
  double owed = 0.5; // every (1/keep)th track
  for (auto& [id, list] : byTrack) {
    owed += keep;
    if (owed < 1) continue;
    owed -= 1;
    for (Sample& s : list) {
      s.offset /= s.count;
      s.velocity /= s.count * t.speed;
      s.time /= s.count;
    }
    t.pieces.push_back(std::move(list));
  }
  return t;
}

class Fit {
public:
  Fit(const Tracks& tracks, const FlowFitOptions& o, double reach, double layerScale) : reach_(reach) {
    for (const auto& track : tracks.pieces) {
      const std::size_t before = samples_.size();
      for (const Sample& s : track)
        if (s.offset.norm() < 1 + reach) samples_.push_back(s);
      for (std::size_t i = before; i < samples_.size(); ++i)
        samples_[i].share = 1. / (samples_.size() - before);
      count_ += samples_.size() > before;
    }
    for (int k = 0; k < Layers; ++k) layers_[k] = layerScale * LayerThickness[k];
    drift_ = tracks.speed * tracks.halfSpan / o.radius;
    centreVariance_ = std::pow(o.centrePrior > 0 ? o.centrePrior / o.radius : 0.2, 2);
    velocityVariance_ = std::pow(o.velocityPrior > 0 ? o.velocityPrior / tracks.speed : 1, 2);
    accelerationVariance_ =
        std::max(1e-12, std::pow(o.accelerationPrior * tracks.halfSpan / tracks.speed, 2));
    noise_.fill(0.01);
    amplitude_.fill(4);
  }

  int tracks() const { return count_; }
  int samples() const { return int(samples_.size()); }
  const VectorXd& state() const { return state_; }
  const MatrixXd& covariance() const { return covariance_; }
  double noise() const { return std::sqrt(noise_[0]); }

  /// Gauss-Newton for the centre; in between the variances, and all that is linear. start: the first twelve.
  /// False: aborted.
  bool solve(const VectorXd& start, int rounds, const Progress& progress) {
    state_.head<Flow>() = start;
    for (int round = 0; round <= rounds; ++round) {
      if (!goOn(progress, double(round) / rounds)) return false;
      linearise(round > 0);
      const Vector3d before = state_.segment<3>(Centre);
      for (int k = 0; k < (round == 0 ? 5 : 3); ++k) regress();
      const Vector3d step = state_.segment<3>(Centre) - before;
      // Without a flow there is no telling where the wall is: the first round is for the flow.
      const double longest = round == 0 ? 0 : LargestStep;
      if (step.norm() > longest) state_.segment<3>(Centre) = before + step * (longest / step.norm());
      if (round > 1 && step.norm() < 1e-3) break;
    }
    return true;
  }

private:
  using Modes = Eigen::Matrix<double, 3, Layers * FitHarmonics::Size>;
  Vector3d offset(const Sample& s) const {
    return s.offset - state_.segment<3>(Centre) -
           drift_ * s.time * (state_.segment<3>(Velocity) + 0.5 * s.time * state_.segment<3>(Acceleration));
  }
  Modes modes(const Vector3d& r) const {
    Modes m;
    noSlipModes<FitDegree>(r, layers_.data(), Layers, m);
    return m;
  }
  /// Of the flow relative to the body, at r: central differences.
  Matrix3d gradient(const Vector3d& r) const {
    constexpr double h = 1e-4;
    Matrix3d g;
    for (int a = 0; a < 3; ++a)
      g.col(a) = (modes(r + h * Vector3d::Unit(a)) - modes(r - h * Vector3d::Unit(a))) *
                 state_.tail(Unknowns - Flow) / (2 * h);
    return g - crossWith(state_.segment<3>(Rotation)).transpose();
  }

  /// velocity = V + A time + omega x r + flow(r), r = offset - centre - V time - A time^2/2, about the
  /// present state: y = X state.
  void linearise(bool robust) {
    std::array<std::vector<std::size_t>, Bands> members;
    for (std::size_t i = 0; i < samples_.size(); ++i)
      members[std::clamp(int(Bands * (offset(samples_[i]).norm() - 1) / reach_), 0, Bands - 1)].push_back(i);
    for (int b = 0; b < Bands; ++b) {
      MatrixXd x(3 * members[b].size(), Unknowns);
      VectorXd y(x.rows());
      weight_[b] = 0;
      for (std::size_t j = 0; j < members[b].size(); ++j) {
        const Sample& s = samples_[members[b][j]];
        const Vector3d r = offset(s);
        const Matrix3d g = gradient(r);
        auto rows = x.middleRows<3>(3 * j);
        rows.rightCols<Unknowns - Flow>() = modes(r);
        rows.middleCols<3>(Rotation) = crossWith(r);
        rows.middleCols<3>(Velocity) = Matrix3d::Identity();
        rows.middleCols<3>(Acceleration) = s.time * Matrix3d::Identity();
        rows.middleCols<3>(Centre).setZero();
        const Vector3d residual = s.velocity - rows * state_;
        rows.middleCols<3>(Centre) = -g;
        rows.middleCols<3>(Velocity) -= drift_ * s.time * g;
        rows.middleCols<3>(Acceleration) -= 0.5 * drift_ * s.time * s.time * g;
        // Student's t with 4 degrees of freedom: ghosts count little.
        const double w = s.share * (robust ? 7 / (4 + residual.squaredNorm() / noise_[b]) : 1);
        y.segment<3>(3 * j) = std::sqrt(w) * (residual + rows * state_);
        rows *= std::sqrt(w);
        weight_[b] += 3 * w;
      }
      gram_[b] = MatrixXd::Zero(Unknowns, Unknowns);
      gram_[b].selfadjointView<Eigen::Lower>().rankUpdate(x.transpose());
      gram_[b].triangularView<Eigen::StrictlyUpper>() = gram_[b].transpose();
      moment_[b] = x.transpose() * y;
      square_[b] = y.squaredNorm();
    }
  }

  /// The linear regression with the present variances, then the variances that suit it: of the noise against
  /// the degrees of freedom that the fit leaves (MacKay 1992), of the flow by expectation-maximisation.
  void regress() {
    constexpr int N = FitHarmonics::Size;
    VectorXd rule(N), precision(Unknowns);
    const std::vector<int> degrees = FitHarmonics::degrees();
    for (int i = 0; i < N; ++i) rule[i] = std::pow(degrees[i], -4);
    precision.segment<3>(Centre).setConstant(1 / centreVariance_);
    precision.segment<3>(Velocity).setConstant(1 / velocityVariance_);
    precision.segment<3>(Acceleration).setConstant(1 / accelerationVariance_);
    precision.segment<3>(Rotation).setConstant(1 / 0.09);
    for (int k = 0; k < Layers; ++k)
      precision.segment<N>(Flow + k * N) = (amplitude_[k] * rule).cwiseInverse();
    MatrixXd a = precision.asDiagonal();
    VectorXd b = VectorXd::Zero(Unknowns);
    for (int k = 0; k < Bands; ++k) {
      a += gram_[k] / noise_[k];
      b += moment_[k] / noise_[k];
    }
    covariance_ = a.llt().solve(MatrixXd::Identity(Unknowns, Unknowns));
    state_ = covariance_ * b;
    for (int k = 0; k < Bands; ++k) {
      const double squares = square_[k] - 2 * state_.dot(moment_[k]) + state_.dot(gram_[k] * state_);
      const double used = covariance_.cwiseProduct(gram_[k]).sum() / noise_[k];
      constexpr double nu = 6; // of the last value, lest a band with few samples runs away
      noise_[k] =
          std::max(1e-6, (std::max(squares, 0.) + nu * noise_[k]) / (std::max(weight_[k] - used, 0.) + nu));
    }
    const VectorXd power = state_.cwiseAbs2() + covariance_.diagonal();
    for (int k = 0; k < Layers; ++k)
      amplitude_[k] = power.segment<N>(Flow + k * N).cwiseQuotient(rule).mean();
  }
  double reach_, drift_, centreVariance_, velocityVariance_, accelerationVariance_;
  int count_ = 0;
  std::array<double, Layers> layers_, amplitude_;
  std::vector<Sample> samples_;
  VectorXd state_ = VectorXd::Zero(Unknowns);
  MatrixXd covariance_;
  std::array<double, Bands> noise_; // variance
  std::array<MatrixXd, Bands> gram_;
  std::array<VectorXd, Bands> moment_;
  std::array<double, Bands> square_, weight_;
};

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

/// Keeps `count` of them, evenly along the list (which follows the index's cells), and returns the
/// velocities.
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
constexpr double Hopeless = -80;         // log Bayes factor that no shift of the centre makes up for
constexpr double NearestToCentre = 0.97; // R; nearer tracers would be ghosts
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

FlowFit fitFlow(const std::vector<FlowView>& views, const FlowFitOptions& options, const Progress& progress) {
  check(options.radius, options.reach);
  FlowFit f;
  if (views.empty()) return f;
  const Tracks tracks = collect(views, options);
  Fit fit(tracks, options, options.reach, 1);
  f.time = tracks.time;
  f.tracks = fit.tracks();
  f.samples = fit.samples();
  if (f.tracks < options.minimumTracks) return f;
  if (!fit.solve(VectorXd::Zero(Flow), 6, part(progress, 0, 0.5))) return f;
  const VectorXd best = fit.state().head<Flow>();
  MatrixXd covariance = fit.covariance().topLeftCorner<Flow, Flow>();
  // What the answer owes to the choice of the model.
  for (const auto& [reach, layers] : {std::pair(0.75, 0.7), std::pair(1.3, 1.4)}) {
    Fit other(tracks, options, reach * options.reach, layers);
    if (other.tracks() < options.minimumTracks) continue;
    if (!other.solve(best, 3, part(progress, reach < 1 ? 0.5 : 0.75, reach < 1 ? 0.75 : 1))) return f;
    const VectorXd difference = other.state().head<Flow>() - best;
    // Half of its square as it is, half in any direction: two models do not show them all.
    covariance += 0.25 * difference * difference.transpose();
    for (int k = 0; k < Flow; k += 3)
      covariance.block<3, 3>(k, k).diagonal().array() += 0.25 / 3 * difference.segment<3>(k).squaredNorm();
  }
  covariance *= 1 + std::pow(FewTracks / f.tracks, 2);
  for (int k = 0; k < Flow; ++k) covariance(k, k) += LeastSigma * LeastSigma;
  f.enough = true;
  f.centre = options.radius * best.segment<3>(Centre);
  f.velocity = tracks.speed * best.segment<3>(Velocity);
  f.acceleration = tracks.speed / tracks.halfSpan * best.segment<3>(Acceleration);
  f.angularVelocity = tracks.speed / options.radius * best.segment<3>(Rotation);
  Eigen::Matrix<double, 9, 1> unit;
  unit << Vector3d::Constant(options.radius), Vector3d::Constant(tracks.speed),
      Vector3d::Constant(tracks.speed / tracks.halfSpan);
  f.covariance = unit.asDiagonal() * covariance.topLeftCorner<9, 9>() * unit.asDiagonal();
  f.angularVelocityCovariance =
      std::pow(tracks.speed / options.radius, 2) * covariance.block<3, 3>(Rotation, Rotation);
  f.noise = tracks.speed * fit.noise();
  return f;
}

FlowEvidence flowEvidence(const std::vector<WallParticle>& particles, const FlowEvidenceOptions& options) {
  check(options.radius, options.reach);
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
