// The pressure from its gradient where the truth is known (Taylor-Green and ABC pressures, a sphere of 16
// nodes masked, noise on the gradient): the one-shot solve beside a plain conjugate-gradient solver of the
// same equations, preconditioned with their diagonal and written for speed, and beside integration along
// parallel lines. Errors, noise amplification, iterations, and times as medians of alternating runs.
//   --grids=64,paper,128   also 256; paper is 160 x 109 x 36
//   --repetitions=9        of every timing, at most
//   --page=FILE            puts the tables into FILE, between its lines <!-- tables --> and <!-- /tables -->
#include "FluidRegions.h"
#include "OneShotPressure.h"
#include "ParallelLinePressure.h"
#include "PressureCases.h"
#include "PressureLinks.h"

#include <chrono>
#include <cstdio>
#include <cstring>
#include <fstream>
#include <functional>
#include <iostream>
#include <omp.h>
#include <sstream>
#include <string>

using namespace rimflow;

namespace {

/// The peer. Fields have a layer of zeros around the grid, so that the loops need no cases; three passes over
/// memory per iteration.
class JacobiCG {
public:
  JacobiCG(const PressureProblem& problem, int order) : grid_(problem.grid) {
    for (int a = 0; a < 3; ++a) weight_[a] = 1 / (grid_.spacing[a] * grid_.spacing[a]);
    row_ = grid_.n[0] + 2, layer_ = row_ * (grid_.n[1] + 2);
    const std::size_t size = layer_ * (grid_.n[2] + 2);
    for (auto* field : {&x_, &r_, &p_, &q_}) field->resize(size);
    diagonal_.resize(size), inverse_.resize(size);
    const PressureLinks links(problem, order);
    forEachRow([&](int j, int k, std::size_t start) {
      for (int i = 0; i < grid_.n[0]; ++i) assemble(links, {i, j, k}, start + i);
      return 0.;
    });
  }

  PressureSolution solve(const PressureProblem& problem, double tolerance) {
    PressureSolution out;
    double rr, rz, alpha = 0, beta = 0;
    const auto updateResidual = [&] {
      sumOverNodes(rr, rz, [&](std::size_t e, double& square, double& product) {
        const double r = r_[e] - alpha * q_[e];
        r_[e] = r;
        square += r * r, product += r * r * inverse_[e];
      });
    };
    updateResidual();
    const double target = tolerance * tolerance * rr;
    for (; rr > target && out.iterations < 5000; ++out.iterations) {
      forEachEntry([&](std::size_t e) {
        x_[e] += alpha * p_[e];
        p_[e] = inverse_[e] * r_[e] + beta * p_[e];
      });
      const double rzBefore = rz;
      alpha = rz / applyMatrix();
      updateResidual();
      beta = rz / rzBefore;
    }
    forEachEntry([&](std::size_t e) { x_[e] += alpha * p_[e]; });
    std::vector<double> pressure(grid_.size());
    forEachRow([&](int j, int k, std::size_t start) {
      std::copy_n(&x_[start], grid_.n[0], &pressure[grid_.index(0, j, k)]);
      return 0.;
    });
    removeRegionMeans(fluidRegions(grid_, problem.mask), pressure.data());
    out.pressure.assign(pressure.begin(), pressure.end());
    return out;
  }

private:
  template <class F>
  double forEachRow(F&& f) {
    double sum = 0;
#pragma omp parallel for schedule(static) reduction(+ : sum)
    for (int k = 0; k < grid_.n[2]; ++k)
      for (int j = 0; j < grid_.n[1]; ++j) sum += f(j, k, (k + 1) * layer_ + (j + 1) * row_ + 1);
    return sum;
  }
  template <class F>
  void forEachEntry(F&& f) {
    const std::size_t size = x_.size();
#pragma omp parallel for simd schedule(static)
    for (std::size_t e = 0; e < size; ++e) f(e);
  }
  template <class F>
  void sumOverNodes(double& firstSum, double& secondSum, F&& f) {
    double first = 0, second = 0;
    const std::size_t size = x_.size();
#pragma omp parallel for simd schedule(static) reduction(+ : first, second)
    for (std::size_t e = 0; e < size; ++e) f(e, first, second);
    firstSum = first, secondSum = second;
  }
  void assemble(const PressureLinks& links, const std::array<int, 3>& at, std::size_t e) {
    const std::size_t node = grid_.index(at[0], at[1], at[2]);
    if (!links.isFluid(node)) return;
    double diagonal = 0, b = 0;
    for (int a = 0; a < 3; ++a) {
      const std::size_t before = node - links.stride(a), after = node + links.stride(a);
      if (at[a] > 0 && links.isFluid(before))
        diagonal += weight_[a], b += weight_[a] * links.difference(before, a, at[a] - 1);
      if (at[a] + 1 < grid_.n[a] && links.isFluid(after))
        diagonal += weight_[a], b -= weight_[a] * links.difference(node, a, at[a]);
    }
    r_[e] = b, diagonal_[e] = float(diagonal), inverse_[e] = diagonal > 0 ? float(1 / diagonal) : 0;
  }
  /// q = A p; returns p . q.
  double applyMatrix() {
    const int n = grid_.n[0];
    const double wx = weight_[0], wy = weight_[1], wz = weight_[2];
    return forEachRow([&](int, int, std::size_t start) {
      const double *p = &p_[start], *south = p - row_, *north = p + row_, *below = p - layer_,
                   *above = p + layer_;
      const float* d = &diagonal_[start];
      double *q = &q_[start], sum = 0;
#pragma omp simd reduction(+ : sum)
      for (int i = 0; i < n; ++i) {
        const double value = d[i] * p[i] - wx * (p[i - 1] + p[i + 1]) - wy * (south[i] + north[i]) -
                             wz * (below[i] + above[i]);
        q[i] = d[i] > 0 ? value : 0;
        sum += p[i] * q[i];
      }
      return sum;
    });
  }
  Grid grid_;
  double weight_[3];
  std::size_t row_, layer_;
  std::vector<double> x_, r_, p_, q_;
  std::vector<float> diagonal_, inverse_;
};

struct Solver {
  std::string name;
  std::function<PressureSolution(const PressureProblem&)> solve;
};

std::vector<Solver> solvers(bool manyDirections) {
  constexpr double Tolerance = 1e-6;
  std::vector<Solver> out;
  for (int order : {4, 2}) {
    const std::string links = order == 4 ? ", fourth order" : ", trapezoid";
    for (double wallWeight : {OneShotOptions().wallWeight, 1.}) {
      if (wallWeight < 1 && order == 2) continue;
      out.push_back({"one-shot" + links + (wallWeight < 1 ? "" : ", all nodes alike"),
                     [=](const PressureProblem& problem) {
                       OneShotOptions options;
                       options.order = order, options.tolerance = Tolerance, options.wallWeight = wallWeight;
                       return oneShotPressure(problem, options);
                     }});
    }
    out.push_back({"Jacobi CG" + links, [=](const PressureProblem& problem) {
                     return JacobiCG(problem, order).solve(problem, Tolerance);
                   }});
    for (int directions : {162, 642}) {
      if (directions == 642 && (!manyDirections || order == 2)) continue;
      out.push_back({std::to_string(directions) + " directions" + links, [=](const PressureProblem& problem) {
                       ParallelLineOptions options;
                       options.directions = directions, options.order = order;
                       options.tolerance = order == 4 ? Tolerance : 1e-4; // trapezoid: as published
                       return parallelLinePressure(problem, options);
                     }});
    }
  }
  return out;
}

double median(std::vector<double> values) {
  std::nth_element(values.begin(), values.begin() + values.size() / 2, values.end());
  return values[values.size() / 2];
}

struct Row {
  PressureErrors clean, white, correlated;
  double amplification[2] = {}; // white, correlated
  int iterations = 0;
  std::vector<double> seconds;
};

/// All solvers on one pressure field: a table in Markdown.
std::string table(const std::string& title, PressureCaseOptions options, int repetitions) {
  constexpr double Enough = 10; // s for one solver
  const std::vector<Solver> all = solvers(/*manyDirections=*/options.nodes[0] <= 64);
  std::vector<Row> rows(all.size());
  std::vector<std::vector<float>> cleanPressure(all.size());
  for (GradientNoise noise : {GradientNoise::None, GradientNoise::Correlated, GradientNoise::White}) {
    options.noise = noise;
    const PressureCase problem = pressureCase(options);
    const int runs = noise == GradientNoise::White ? repetitions : 1;
    std::vector<double> used(all.size(), 0);
    for (int run = 0; run < runs; ++run)
      for (std::size_t s = 0; s < all.size(); ++s) {
        if (used[s] > Enough) continue;
        const auto start = std::chrono::steady_clock::now();
        const PressureSolution found = all[s].solve(problem.problem());
        const std::chrono::duration<double> took = std::chrono::steady_clock::now() - start;
        used[s] += took.count();
        if (noise == GradientNoise::White) rows[s].seconds.push_back(took.count());
        if (run > 0) continue;
        const PressureErrors errors = pressureErrors(problem, found.pressure);
        if (noise == GradientNoise::None) {
          rows[s].clean = errors;
          cleanPressure[s] = found.pressure;
          continue;
        }
        const bool white = noise == GradientNoise::White;
        (white ? rows[s].white : rows[s].correlated) = errors;
        rows[s].amplification[!white] = noiseAmplification(problem, found.pressure, cleanPressure[s]);
        rows[s].iterations = found.iterations;
      }
  }
  std::ostringstream out;
  out << "**" << title
      << "**\n\n| solver | clean | white noise | next to the mask | noise amplification | correlated noise | "
         "amplification | iterations | time, s | times ours |\n"
         "| --- | --- | --- | --- | --- | --- | --- | --- | --- | --- |\n";
  for (std::size_t s = 0; s < all.size(); ++s) {
    const Row& row = rows[s];
    char wall[16] = "-", line[256];
    if (options.maskDiameter > 0) std::snprintf(wall, sizeof wall, "%.3f %%", 100 * row.white.wall);
    std::snprintf(line, sizeof line,
                  "| %s | %.3f %% | %.3f %% | %s | %.3f | %.2f %% | %.2f | %d | %.3f | %.2f |\n",
                  all[s].name.c_str(), 100 * row.clean.all, 100 * row.white.all, wall, row.amplification[0],
                  100 * row.correlated.all, row.amplification[1], row.iterations, median(row.seconds),
                  median(row.seconds) / median(rows[0].seconds));
    out << line;
  }
  out << "\n";
  return out.str();
}

/// Replaces what stands between the two marks of a page.
bool writePage(const std::string& path, const std::string& tables) {
  const std::string open = "<!-- tables -->\n", close = "<!-- /tables -->";
  std::stringstream text;
  text << std::ifstream(path).rdbuf();
  std::string page = text.str();
  const std::size_t begin = page.find(open), end = page.find(close);
  if (begin == std::string::npos || end == std::string::npos) {
    std::cerr << path << " has no lines <!-- tables --> and <!-- /tables -->\n";
    return false;
  }
  page.replace(begin + open.size(), end - begin - open.size(), "\n" + tables);
  return bool(std::ofstream(path) << page);
}

} // namespace

int main(int argc, char** argv) {
  std::string grids = "64,paper,128", page;
  int repetitions = 9;
  for (int a = 1; a < argc; ++a) {
    const std::string argument = argv[a];
    const auto value = [&](const char* name, std::string& to) {
      if (argument.rfind(name, 0) == 0) to = argument.substr(std::strlen(name));
      return argument.rfind(name, 0) == 0;
    };
    std::string number;
    if (value("--grids=", grids) || value("--page=", page)) continue;
    if (value("--repetitions=", number)) {
      repetitions = std::max(1, std::atoi(number.c_str()));
      continue;
    }
    if (argument.rfind("--benchmark_", 0) == 0) continue; // for the other benchmarks of the same command
    std::cerr << "usage: BenchPressure [--grids=64,paper,128,256] [--repetitions=9] [--page=FILE]\n";
    return argument == "--help" ? 0 : 1;
  }
  std::string tables = "Threads: " + std::to_string(omp_get_max_threads()) + ".\n\n";
  std::cout << tables;
  const auto add = [&](const std::string& title, const PressureCaseOptions& options) {
    const std::string one = table(title, options, repetitions);
    std::cout << one << std::flush;
    tables += one;
  };
  for (PressureField field : {PressureField::TaylorGreen, PressureField::ABC}) {
    const std::string name = field == PressureField::ABC ? "ABC" : "Taylor-Green";
    std::istringstream list(grids);
    for (std::string grid; std::getline(list, grid, ',');) {
      PressureCaseOptions options;
      options.field = field;
      const int n = std::atoi(grid.c_str());
      if (grid == "paper")
        options.nodes = {160, 109, 36};
      else if (n >= 17)
        options.nodes = {n, n, n};
      else {
        std::cerr << "--grids: '" << grid << "' is neither paper nor a number from 17 on\n";
        return 1;
      }
      const std::string size = grid == "paper" ? "160 x 109 x 36" : grid + " x " + grid + " x " + grid;
      add(name + ", " + size + ", a sphere of 16 nodes masked", options);
      if (field == PressureField::ABC || grid != "64") continue;
      options.maskDiameter = 0;
      add(name + ", " + size + ", nothing masked", options);
    }
  }
  return page.empty() || writePage(page, tables) ? 0 : 1;
}
