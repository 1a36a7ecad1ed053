#pragma once
#include "LBFGS.h"
#include "VICSharp.h"

#include <algorithm>
#include <cmath>
#include <memory>
#include <vector>

namespace rimflow {

/// Minimises the cost on one grid after the other. In float: half the memory and time of double, and far
/// below the noise of any measurement.
class VICSharpReconstruction {
public:
  using Model = VICSharpModel<float>;

  VICSharpReconstruction(const VICSharpData& data, const VICSharpConstants& constants,
                         const VICSharpOptions& options)
      : data_(data), constants_(constants), options_(options) {}

  bool aborted() const { return aborted_; }
  Model& model() { return *model_; }
  const Model& model() const { return *model_; }

  /// To another grid, from a solution on any grid or from zero.
  void moveTo(const Grid& grid, const Model::State* start) {
    model_ = std::make_unique<Model>(grid, data_, constants_);
    x_ = start ? model_->unknowns(*start) : std::vector<float>(model_->size(), 0.f);
  }
  void restart(double curvatureWeight, const Model::State& start) {
    constants_.curvatureWeight = curvatureWeight;
    model_->setWeights(constants_);
    x_ = model_->unknowns(start);
  }

  /// alpha, from the next start on.
  void weighAccelerations(double alpha) { constants_.accelerationWeight = alpha; }

  /// An iteration must gain the part `tolerance` of the variance of this noise.
  void useNoise(double velocity, double acceleration, double tolerance) {
    gain_ = 3 * std::pow(velocity / constants_.velocityScale, 2);
    if (!data_.acceleration.empty())
      gain_ += 3 * std::pow(constants_.accelerationWeight * acceleration / constants_.accelerationScale, 2);
    gain_ *= tolerance;
  }
  /// Particles that miss by more than so many times this noise count linearly. From a poor start that would
  /// be most of them, and the large scales would come slowly: so only once there is a solution. Holds from
  /// the next start on.
  void suppressOutliers(double velocityNoise, double accelerationNoise) {
    constants_.velocityOutlier = options_.outliers * velocityNoise;
    constants_.accelerationOutlier = options_.outliers * accelerationNoise;
  }

  /// Up to `maximum` iterations, fewer once an iteration gains less than the tolerance allows (mean of five).
  LBFGSResult minimise(int maximum, const Progress& progress) {
    constexpr std::size_t Window = 5;
    LBFGSOptions options;
    options.maximumIterations = maximum;
    options.memory = 2;
    options.firstStep = 0.1 * double(model_->grid().size()); // the Hessian is a few times 2/N
    std::vector<double> values;
    const auto goOnWith = [&](const LBFGSState& s, const std::vector<float>&) {
      aborted_ = !goOn(progress, std::min(1., double(s.iteration) / maximum));
      values.push_back(s.value);
      const std::size_t n = values.size();
      return !aborted_ && (n <= Window || values[n - 1 - Window] - values[n - 1] > Window * gain_);
    };
    struct Stopped {}; // out of a line search
    const auto cost = [&](const std::vector<float>& x, std::vector<float>& g) {
      if (!goOn(progress, std::min(1., double(values.size()) / maximum))) throw Stopped();
      return model_->cost(x, g);
    };
    LBFGSResult result;
    try {
      result = LBFGS<float>(options).minimise(cost, x_, goOnWith);
    } catch (const Stopped&) {
      aborted_ = true;
      result.status = LBFGSStatus::StoppedByCaller;
    }
    if (result.status == LBFGSStatus::NoProgress) { // the model stands where a trial failed
      std::vector<float> gradient(x_.size());
      model_->cost(x_, gradient);
    }
    return result;
  }

private:
  const VICSharpData& data_;
  VICSharpConstants constants_;
  const VICSharpOptions& options_;
  std::unique_ptr<Model> model_;
  std::vector<float> x_;
  double gain_ = 0; ///< of J, that an iteration must bring
  bool aborted_ = false;
};

} // namespace rimflow
