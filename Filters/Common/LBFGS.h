#pragma once
#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <functional>
#include <vector>

namespace rimflow {

struct LBFGSOptions {
  int maximumIterations = 100;
  int memory = 5;                     ///< pairs of steps and gradient changes kept, >= 1
  double relativeGradientNorm = 1e-6; ///< stop when |g| <= this |g at the start|
  double sufficientDecrease = 1e-4;   ///< c1 of the Wolfe conditions
  double curvature = 0.9;             ///< c2 of the Wolfe conditions, c1 < c2 < 1
  double valueRounding = 1e-7; ///< relative rounding of f: below it the line search trusts slopes alone
  double firstStep = 0;        ///< along -g, tried at the start, > 0: 1 over the curvature expected; 0: 1/|g|
  int maximumEvaluationsPerSearch = 20;
};

enum class LBFGSStatus {
  Converged,         ///< the gradient is small enough
  MaximumIterations, ///< not converged yet
  StoppedByCaller,   ///< the callback returned false
  NoProgress         ///< no lower value along the steepest descent: the limit of rounding
};

struct LBFGSResult {
  LBFGSStatus status = LBFGSStatus::MaximumIterations;
  int iterations = 0, evaluations = 0;
  double value = 0, gradientNorm = 0;
};

/// Where the minimisation stands after an iteration.
struct LBFGSState {
  int iteration;
  double value, gradientNorm;
};

/// Minimises f by L-BFGS (Liu & Nocedal 1989) with a strong Wolfe line search (Nocedal & Wright 2006,
/// algorithms 3.5 and 3.6; near the limit of rounding the approximate conditions of Hager & Zhang 2005).
/// f(x, g) returns the value and writes the gradient; x and g are arrays of x.size() numbers of type Real,
/// sums over them are taken in double. x holds the start and then the best point found. callback is called
/// after each iteration with x; false stops.
template <class Real>
class LBFGS {
public:
  using Vector = std::vector<Real>;
  using Function = std::function<double(const Vector& x, Vector& gradient)>;
  using Callback = std::function<bool(const LBFGSState&, const Vector& x)>;

  explicit LBFGS(LBFGSOptions options = {}) : options_(options) {}

  LBFGSResult minimise(const Function& f, Vector& x, const Callback& callback = {}) {
    const std::size_t n = x.size();
    Vector gradient(n), direction(n), trial(n), trialGradient(n);
    history_.clear();
    LBFGSResult result;
    result.value = f(x, gradient);
    ++result.evaluations;
    double norm = std::sqrt(dot(gradient, gradient));
    const double target = options_.relativeGradientNorm * norm;
    result.gradientNorm = norm;
    while (true) {
      if (norm <= target) {
        result.status = LBFGSStatus::Converged;
        break;
      }
      if (result.iterations >= options_.maximumIterations) break;
      double slope = setDirection(gradient, direction);
      if (!(slope < 0)) {
        history_.clear();
        slope = setDirection(gradient, direction);
      }
      const double steepest = options_.firstStep > 0 ? options_.firstStep : 1 / norm;
      const double first = history_.empty() ? steepest : 1;
      const double step = search(f, x, result.value, slope, direction, first, trial, trialGradient, result);
      if (step == 0) {
        if (history_.empty()) {
          result.status = LBFGSStatus::NoProgress;
          break;
        }
        history_.clear(); // start again from the steepest descent
        continue;
      }
      remember(x, trial, gradient, trialGradient);
      norm = std::sqrt(dot(gradient, gradient));
      result.gradientNorm = norm;
      ++result.iterations;
      if (callback && !callback({result.iterations, result.value, norm}, x)) {
        result.status = LBFGSStatus::StoppedByCaller;
        break;
      }
    }
    return result;
  }

private:
  static constexpr std::size_t Chunk = 8192; ///< numbers that a thread keeps in its cache

  struct Pair {
    Vector s, y; ///< step and change of the gradient
  };

  /// Sums of M products over all elements, the same for any number of threads.
  template <int M, class F>
  static std::array<double, M> sums(std::size_t n, F&& f) {
    const std::ptrdiff_t chunks = std::ptrdiff_t((n + Chunk - 1) / Chunk);
    std::vector<std::array<double, M>> partial(chunks);
#pragma omp parallel for schedule(static)
    for (std::ptrdiff_t c = 0; c < chunks; ++c)
      partial[c] = f(c * Chunk, std::min(n, std::size_t(c + 1) * Chunk));
    std::array<double, M> total{};
    for (const auto& p : partial)
      for (int m = 0; m < M; ++m) total[m] += p[m];
    return total;
  }
  static double dot(const Real* a, const Real* b, std::size_t from, std::size_t to) {
    double sum = 0;
#pragma omp simd reduction(+ : sum)
    for (std::size_t i = from; i < to; ++i) sum += double(a[i]) * double(b[i]);
    return sum;
  }
  static double dot(const Vector& a, const Vector& b) {
    return sums<1>(a.size(), [&](std::size_t from, std::size_t to) {
      return std::array<double, 1>{dot(a.data(), b.data(), from, to)};
    })[0];
  }

  /// direction = -H gradient by the two-loop recursion, carried out on the coefficients of s_i, y_i and the
  /// gradient, so that the history is read twice and nothing else. Returns direction . gradient.
  double setDirection(const Vector& gradient, Vector& direction) {
    const int pairs = int(history_.size()), vectors = 2 * pairs;
    std::vector<const Real*> basis;
    for (const Pair& p : history_) basis.push_back(p.s.data());
    for (const Pair& p : history_) basis.push_back(p.y.data());
    updateProducts(basis, gradient);

    // q = gradient + sum of coefficient[v] basis[v]
    std::vector<double> coefficient(vectors, 0.), alpha(pairs);
    double gradientScale = 1;
    const auto dotWith = [&](int v) {
      double sum = gradientScale * gradientProducts_[v];
      for (int w = 0; w < vectors; ++w) sum += coefficient[w] * products_[v][w];
      return sum;
    };
    for (int i = pairs - 1; i >= 0; --i) {
      alpha[i] = dotWith(i) / products_[i][pairs + i];
      coefficient[pairs + i] -= alpha[i];
    }
    if (pairs > 0) {
      const int last = pairs - 1;
      const double scale = products_[last][pairs + last] / products_[pairs + last][pairs + last];
      gradientScale = scale;
      for (double& c : coefficient) c *= scale;
    }
    for (int i = 0; i < pairs; ++i) coefficient[i] += alpha[i] - dotWith(pairs + i) / products_[i][pairs + i];

    return sums<1>(gradient.size(), [&](std::size_t from, std::size_t to) {
      for (std::size_t i = from; i < to; ++i) direction[i] = Real(-gradientScale * gradient[i]);
      for (int v = 0; v < vectors; ++v) {
        const Real c = Real(-coefficient[v]), *b = basis[v];
#pragma omp simd
        for (std::size_t i = from; i < to; ++i) direction[i] += c * b[i];
      }
      return std::array<double, 1>{dot(direction.data(), gradient.data(), from, to)};
    })[0];
  }

  /// products_[v][w] = basis_v . basis_w and gradientProducts_[v] = basis_v . gradient; only the newest
  /// pair's rows are new.
  void updateProducts(const std::vector<const Real*>& basis, const Vector& gradient) {
    const int vectors = int(basis.size()), pairs = vectors / 2;
    if (vectors == 0) return;
    const Real *step = basis[pairs - 1], *change = basis[vectors - 1];
    const std::size_t n = gradient.size();
    const std::ptrdiff_t chunks = std::ptrdiff_t((n + Chunk - 1) / Chunk);
    std::vector<double> partial(chunks * 3 * vectors);
#pragma omp parallel for schedule(static)
    for (std::ptrdiff_t c = 0; c < chunks; ++c)
      for (int v = 0; v < vectors; ++v) {
        const Real* b = basis[v];
        const std::size_t to = std::min(n, std::size_t(c + 1) * Chunk);
        double withStep = 0, withChange = 0, withGradient = 0;
#pragma omp simd reduction(+ : withStep, withChange, withGradient)
        for (std::size_t i = c * Chunk; i < to; ++i) {
          withStep += double(b[i]) * double(step[i]);
          withChange += double(b[i]) * double(change[i]);
          withGradient += double(b[i]) * double(gradient[i]);
        }
        double* out = &partial[(c * vectors + v) * 3];
        out[0] = withStep, out[1] = withChange, out[2] = withGradient;
      }
    std::vector<double> total(3 * vectors, 0.);
    for (std::ptrdiff_t c = 0; c < chunks; ++c)
      for (int e = 0; e < 3 * vectors; ++e) total[e] += partial[c * 3 * vectors + e];

    // The older pairs' products move to their new places.
    std::vector<std::vector<double>> products(vectors, std::vector<double>(vectors));
    const int dropped = dropped_ ? 1 : 0, oldPairs = pairs - 1 + dropped;
    const auto oldPlace = [&](int v) { return v < pairs ? v + dropped : v - pairs + dropped + oldPairs; };
    for (int v = 0; v < vectors; ++v)
      for (int w = 0; w < vectors; ++w)
        if (v % pairs != pairs - 1 && w % pairs != pairs - 1)
          products[v][w] = products_[oldPlace(v)][oldPlace(w)];
    gradientProducts_.resize(vectors);
    for (int v = 0; v < vectors; ++v) {
      products[v][pairs - 1] = products[pairs - 1][v] = total[3 * v];
      products[v][vectors - 1] = products[vectors - 1][v] = total[3 * v + 1];
      gradientProducts_[v] = total[3 * v + 2];
    }
    products_.swap(products);
    dropped_ = false;
  }

  /// Keeps the step from x to next and the change of the gradient; x and gradient become the next ones.
  void remember(Vector& x, Vector& next, Vector& gradient, Vector& nextGradient) {
    const auto product = sums<1>(x.size(), [&](std::size_t from, std::size_t to) {
      for (std::size_t i = from; i < to; ++i) {
        x[i] = next[i] - x[i];
        gradient[i] = nextGradient[i] - gradient[i];
      }
      return std::array<double, 1>{dot(x.data(), gradient.data(), from, to)};
    });
    Pair pair;
    if (int(history_.size()) >= options_.memory) {
      pair = std::move(history_.front());
      history_.erase(history_.begin());
      dropped_ = true;
    }
    pair.s.resize(x.size());
    pair.y.resize(x.size());
    pair.s.swap(x), pair.y.swap(gradient);
    x.swap(next), gradient.swap(nextGradient);
    history_.push_back(std::move(pair));
    if (!(product[0] > 0)) history_.clear(); // no curvature to learn from: start again
    if (history_.empty()) dropped_ = false;
  }

  struct Trial {
    double step, value, slope;
  };

  /// A step along direction that meets the Wolfe conditions; 0 when none was found. trial and trialGradient
  /// then belong to it.
  double search(const Function& f, const Vector& x, double& value, double slope, const Vector& direction,
                double first, Vector& trial, Vector& trialGradient, LBFGSResult& result) const {
    const Trial start{0, value, slope};
    const auto evaluate = [&](double step) {
      const Real t = Real(step);
#pragma omp parallel for simd schedule(static)
      for (std::size_t i = 0; i < x.size(); ++i) trial[i] = x[i] + t * direction[i];
      Trial out{step, f(trial, trialGradient), 0};
      ++result.evaluations;
      out.slope = dot(trialGradient, direction);
      return out;
    };
    const double slack = options_.valueRounding * std::abs(value);
    const auto low = [&](const Trial& t) {
      if (!std::isfinite(t.value)) return false;
      if (t.value <= start.value + options_.sufficientDecrease * t.step * slope) return true;
      return t.value <= start.value + slack && t.slope <= (2 * options_.sufficientDecrease - 1) * slope;
    };
    const auto flat = [&](const Trial& t) { return std::abs(t.slope) <= -options_.curvature * slope; };

    Trial best = start, bound{0, 0, 0};
    bool bracketed = false;
    double step = first;
    for (int e = 0; e < options_.maximumEvaluationsPerSearch; ++e) {
      const Trial t = evaluate(step);
      if (low(t) && flat(t)) {
        value = t.value;
        return t.step;
      }
      // [best, bound] holds a minimum once bracketed; best is the lowest point with sufficient decrease.
      if (!low(t) || (best.step > 0 && t.value > best.value + slack)) {
        bound = t;
        bracketed = true;
      } else {
        if (t.slope * (bracketed ? bound.step - best.step : 1) >= 0) {
          bound = best;
          bracketed = true;
        }
        best = t;
      }
      step = bracketed ? between(best, bound) : beyond(start, best);
      if (bracketed && std::abs(bound.step - best.step) <= 1e-12 * std::max(bound.step, best.step)) break;
    }
    if (best.step == 0) return 0;
    const Trial t = evaluate(best.step); // sufficient decrease alone
    value = t.value;
    return t.step;
  }

  /// The minimum of the cubic through two points and slopes (of the parabola, if that fails), kept away from
  /// the ends.
  static double between(const Trial& a, const Trial& b) {
    const double width = b.step - a.step;
    double t = 0.5;
    if (std::isfinite(b.value)) {
      const double d1 = a.slope + b.slope - 3 * (a.value - b.value) / (a.step - b.step);
      const double square = d1 * d1 - a.slope * b.slope;
      if (square >= 0) {
        const double d2 = (width > 0 ? 1 : -1) * std::sqrt(square);
        t = 1 - (b.slope + d2 - d1) / (b.slope - a.slope + 2 * d2);
      }
      if (!std::isfinite(t)) t = 0.5;
    } else {
      t = 0.1;
    }
    return a.step + std::clamp(t, 0.05, 0.95) * width;
  }
  /// Further along: where the slope would vanish, between 2 and 1000 times the present step.
  static double beyond(const Trial& start, const Trial& t) {
    const double change = t.slope - start.slope;
    const double secant = change > 0 ? -start.slope / change * t.step : 0;
    return std::clamp(secant, 2 * t.step, 1000 * t.step);
  }

  LBFGSOptions options_;
  std::vector<Pair> history_; ///< oldest first
  std::vector<std::vector<double>> products_;
  std::vector<double> gradientProducts_;
  bool dropped_ = false;
};

} // namespace rimflow
