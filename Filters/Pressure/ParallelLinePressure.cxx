#include "ParallelLinePressure.h"

#include "FluidRegions.h"
#include "GeodesicSphere.h"
#include "PressureLinks.h"

#include <Eigen/Dense>
#include <atomic>
#include <cmath>
#include <cstdint>
#include <limits>
#include <stdexcept>
#include <string>

namespace rimflow {
namespace {

using Eigen::Vector3d;
constexpr int Memory = 10; // of Anderson's method
constexpr double Pi = 3.14159265358979323846;

// Directions, one of each opposite pair: on the sphere, or in the plane or on the line of the axes that have
// more than one node.
std::vector<Vector3d> halfOfDirections(const Grid& grid, int directions) {
  std::vector<int> axes;
  for (int a = 0; a < 3; ++a)
    if (grid.n[a] > 1) axes.push_back(a);
  std::vector<Vector3d> out;
  if (axes.size() == 3)
    for (const auto& e : icosphereDirections(directions)) out.emplace_back(e[0], e[1], e[2]);
  if (axes.size() == 2)
    for (int d = 0; d < (directions + 1) / 2; ++d) {
      const double angle = 2 * Pi * (d + 0.3) / directions;
      out.push_back(std::cos(angle) * Vector3d::Unit(axes[0]) + std::sin(angle) * Vector3d::Unit(axes[1]));
    }
  if (axes.size() == 1) out.push_back(Vector3d::Unit(axes[0]));
  return out;
}

// Of the axes with more than one node.
double smallestSpacing(const Grid& grid) {
  double smallest = std::numeric_limits<double>::infinity();
  for (int a = 0; a < 3; ++a)
    if (grid.n[a] > 1) smallest = std::min(smallest, grid.spacing[a]);
  return std::isfinite(smallest) ? smallest : 1;
}

// What a line needs at a node it passes. The steps are rounded to float, as the gradient is; their sums are
// not.
struct Node {
  float step[3];         // pressure difference to the next node of each axis; 0 where that is no fluid
  std::int32_t boundary; // number among the boundary nodes, or one of the next two
};
constexpr std::int32_t Interior = -1, NoFluid = -2;

// What the lines run through: steps, and the boundary nodes, where the fluid ends on one side at least.
struct Field {
  Grid grid;
  std::array<std::ptrdiff_t, 3> stride;
  std::vector<Node> nodes;
  std::vector<std::size_t> boundary;

  Field(const PressureProblem& problem, int order, double lineSpacing)
      : grid(problem.grid), nodes(grid.size()) {
    const PressureLinks links(problem, order);
    for (int a = 0; a < 3; ++a)
      if (grid.n[a] == 1) grid.spacing[a] = lineSpacing; // one line across, whatever the image says
    for (int a = 0; a < 3; ++a) stride[a] = links.stride(a);
#pragma omp parallel for schedule(static)
    for (int k = 0; k < grid.n[2]; ++k)
      for (int j = 0; j < grid.n[1]; ++j)
        for (int i = 0; i < grid.n[0]; ++i) nodes[grid.index(i, j, k)] = node(links, i, j, k);
    for (std::size_t p = 0; p < nodes.size(); ++p) {
      if (nodes[p].boundary < 0) continue;
      nodes[p].boundary = std::int32_t(boundary.size());
      boundary.push_back(p);
    }
  }

private:
  Node node(const PressureLinks& links, int i, int j, int k) const {
    const std::size_t p = grid.index(i, j, k);
    const int at[3] = {i, j, k};
    Node out{{0, 0, 0}, NoFluid};
    if (!links.isFluid(p)) return out;
    out.boundary = Interior;
    for (int a = 0; a < 3; ++a) {
      if (grid.n[a] == 1) continue;
      const bool before = at[a] > 0 && links.isFluid(p - stride[a]),
                 after = at[a] + 1 < grid.n[a] && links.isFluid(p + stride[a]);
      if (after) out.step[a] = float(links.difference(p, a, at[a]));
      if (!before || !after) out.boundary = 0;
    }
    return out;
  }
};

// A line's way through the fluid: its nodes, and the integral of the gradient from the first to each.
struct Segment {
  std::vector<std::uint32_t> node;
  std::vector<double> integral;
  std::size_t size = 0;

  explicit Segment(const Grid& grid) {
    const std::size_t longest = std::size_t(grid.n[0]) + grid.n[1] + grid.n[2];
    node.resize(longest), integral.resize(longest);
  }
  double total() const { return integral[size - 1]; }
};

// All the lines of one direction: a square lattice across it.
class Lines {
public:
  // shift: of the lattice, in spacings
  Lines(const Field& field, const Vector3d& direction, double spacing, const std::array<double, 2>& shift)
      : field_(field), spacing_(spacing) {
    const Grid& g = field.grid;
    Vector3d across[2];
    // As far along x as can be: then the next line meets nodes that lie next to this one's in memory.
    const Vector3d along = std::abs(direction.x()) < 0.9 ? Vector3d::UnitX() : Vector3d::UnitY();
    across[0] = (along - along.dot(direction) * direction).normalized();
    across[1] = direction.cross(across[0]);
    for (int a = 0; a < 3; ++a) direction_[a] = direction[a] / g.spacing[a];
    for (int l = 0; l < 2; ++l) {
      double middle = 0, reach = 0; // of the grid's box on this axis of the lattice
      for (int a = 0; a < 3; ++a) {
        across_[l][a] = across[l][a] / g.spacing[a];
        middle += 0.5 * g.n[a] * g.spacing[a] * across[l][a];
        reach += 0.5 * g.n[a] * g.spacing[a] * std::abs(across[l][a]);
      }
      first_[l] = std::ceil((middle - reach) / spacing - shift[l]) + shift[l];
      count_[l] = int(std::floor((middle + reach) / spacing - first_[l])) + 1;
    }
    // Lines of one strip and the next but one never meet the same cell.
    const double cell = std::hypot(g.spacing[0], g.spacing[1], g.spacing[2]);
    stripWidth_ = std::max(4, int(std::ceil(cell / spacing)));
    strips_ = (count_[1] + stripWidth_ - 1) / stripWidth_;
  }
  int strips() const { return strips_; }

  // Calls visit(strip, segment) for every segment of two nodes or more. Strips run in parallel, but never two
  // that could touch the same node; each node is reached in the same order with any number of threads.
  template <class F>
  void forEachSegment(F&& visit) const {
#pragma omp parallel
    {
      Segment segment(field_.grid);
      for (int colour = 0; colour < 2; ++colour) {
#pragma omp for schedule(dynamic)
        for (int strip = colour; strip < strips_; strip += 2)
          for (int b = strip * stripWidth_; b < std::min((strip + 1) * stripWidth_, count_[1]); ++b)
            for (int a = 0; a < count_[0]; ++a) {
              double origin[3];
              for (int x = 0; x < 3; ++x)
                origin[x] = spacing_ * ((first_[0] + a) * across_[0][x] + (first_[1] + b) * across_[1][x]);
              walk(origin, segment, [&] { visit(strip, segment); });
            }
      }
    }
  }

private:
  // Walks along one line through the cells around the nodes (Amanatides & Woo 1987), in units of cells, with
  // node i in the middle of [i, i + 1]. close() is called with each segment complete.
  template <class F>
  void walk(const double* origin, Segment& segment, F&& close) const {
    const Grid& g = field_.grid;
    double enter = -std::numeric_limits<double>::infinity(), leave = -enter;
    for (int a = 0; a < 3; ++a) {
      if (direction_[a] == 0) {
        if (origin[a] < 0 || origin[a] >= g.n[a]) return;
        continue;
      }
      const double low = -origin[a] / direction_[a], high = (g.n[a] - origin[a]) / direction_[a];
      enter = std::max(enter, std::min(low, high));
      leave = std::min(leave, std::max(low, high));
    }
    leave -= 1e-9 * (leave - enter); // the face itself is not crossed, whatever the rounding
    if (!(enter < leave)) return;

    double next[3], period[3]; // where the line crosses the next cell face of each axis
    std::ptrdiff_t step[3], link[3];
    float sign[3];
    std::ptrdiff_t at = 0;
    for (int a = 0; a < 3; ++a) {
      const int cell =
          std::clamp(int(std::floor(origin[a] + enter * direction_[a])), 0, field_.grid.n[a] - 1);
      const bool forward = direction_[a] > 0;
      at += cell * field_.stride[a];
      step[a] = forward ? field_.stride[a] : -field_.stride[a];
      link[a] = forward ? 0 : step[a];
      sign[a] = forward ? 1 : -1;
      const bool still = direction_[a] == 0;
      next[a] =
          still ? std::numeric_limits<double>::infinity() : (cell + forward - origin[a]) / direction_[a];
      period[a] = still ? 0 : std::abs(1 / direction_[a]);
    }
    const Node* nodes = field_.nodes.data();
    double integral = 0;
    segment.size = 0;
    const auto end = [&] {
      if (segment.size > 1) close();
      segment.size = 0;
    };
    while (true) {
      if (nodes[at].boundary != NoFluid) {
        if (segment.size == 0) integral = 0;
        segment.node[segment.size] = std::uint32_t(at);
        segment.integral[segment.size++] = integral;
      } else if (segment.size > 0)
        end();
      const int a = next[0] < next[1] ? (next[0] < next[2] ? 0 : 2) : (next[1] < next[2] ? 1 : 2);
      if (next[a] >= leave) break;
      next[a] += period[a];
      integral += sign[a] * nodes[at + link[a]].step[a];
      at += step[a];
    }
    end();
  }

  const Field& field_;
  double spacing_;
  double direction_[3], across_[2][3]; // in cells per m
  double first_[2];                    // line of the lattice, in spacings
  int count_[2], stripWidth_, strips_;
};

// Every direction's lines; the lattices are shifted by the R2 sequence (Roberts 2018), so that they do not
// line up.
class AllLines {
public:
  AllLines(const Field& field, int directions, double spacing)
      : field_(field), directions_(halfOfDirections(field.grid, directions)), spacing_(spacing) {}
  int directions() const { return int(directions_.size()); }
  Lines operator[](int d) const {
    const auto fraction = [](double x) { return x - std::floor(x); };
    return Lines(field_, directions_[d], spacing_,
                 {fraction(0.5 + d * 0.7548776662466927), fraction(0.5 + d * 0.5698402909980532)});
  }

private:
  const Field& field_;
  std::vector<Vector3d> directions_;
  double spacing_;
};

// The boundary's pressure as a fixed point: p_b = (known_b + sum of p over ends_b)/(passes of b), the ends
// being those of the segments through b.
class BoundaryEquation {
public:
  explicit BoundaryEquation(std::size_t nodes) : known_(nodes, 0), passes_(nodes, 0) {}

  // Adds all the segments of one direction.
  void add(const Field& field, const Lines& lines) {
    std::vector<std::vector<std::uint32_t>> perStrip(lines.strips());
    lines.forEachSegment([&](int strip, const Segment& s) {
      const std::size_t last = s.size - 1;
      const std::uint32_t first = number(field, s.node[0]), end = number(field, s.node[last]);
      std::vector<std::uint32_t>& pairs = perStrip[strip];
      const auto from = [&](std::uint32_t b, std::uint32_t source, double integral) {
        known_[b] += integral;
        ++passes_[b];
        pairs.push_back(b), pairs.push_back(source);
      };
      for (std::size_t m = 0; m <= last; ++m) {
        const std::int32_t b = field.nodes[s.node[m]].boundary;
        if (b < 0) continue;
        if (m > 0) from(b, first, s.integral[m]);
        if (m < last) from(b, end, s.integral[m] - s.total());
      }
    });
    pairs_.insert(pairs_.end(), std::make_move_iterator(perStrip.begin()),
                  std::make_move_iterator(perStrip.end()));
  }

  // Sorts what has been added by node. False: aborted.
  bool finish(const Progress& progress) {
    start_.assign(passes_.size() + 1, 0);
    for (std::size_t b = 0; b < passes_.size(); ++b) start_[b + 1] = start_[b] + passes_[b];
    std::vector<std::size_t> at(start_.begin(), start_.end() - 1);
    ends_.resize(start_.back());
    for (std::size_t chunk = 0; chunk < pairs_.size(); ++chunk) {
      if (!goOn(progress, double(chunk) / double(pairs_.size()))) return false;
      std::vector<std::uint32_t> pairs;
      pairs.swap(pairs_[chunk]);
      for (std::size_t e = 0; e < pairs.size(); e += 2) ends_[at[pairs[e]]++] = pairs[e + 1];
    }
    pairs_.clear();
    return true;
  }

  // False: aborted.
  bool apply(const Eigen::VectorXd& p, Eigen::VectorXd& out, const Progress& progress) const {
    constexpr std::size_t Blocks = 16; // of nodes, between which progress is asked
    const std::size_t n = passes_.size();
    for (std::size_t block = 0; block < Blocks; ++block) {
      if (!goOn(progress, double(block) / Blocks)) return false;
#pragma omp parallel for schedule(static)
      for (std::size_t b = block * n / Blocks; b < (block + 1) * n / Blocks; ++b) {
        double sum = known_[b];
        for (std::size_t e = start_[b]; e < start_[b + 1]; ++e) sum += p[ends_[e]];
        out[b] = passes_[b] > 0 ? sum / passes_[b] : 0;
      }
    }
    return true;
  }

private:
  static std::uint32_t number(const Field& field, std::uint32_t node) {
    return std::uint32_t(field.nodes[node].boundary);
  }
  std::vector<double> known_;
  std::vector<std::uint32_t> passes_, ends_;
  std::vector<std::vector<std::uint32_t>> pairs_; // node and end, one after the other
  std::vector<std::size_t> start_;
};

// Mean 0 over the boundary of each region: the iteration leaves the constants free.
void removeMeans(const std::vector<int>& region, int regions, Eigen::VectorXd& p) {
  std::vector<double> sum(regions, 0), count(regions, 0);
  for (std::size_t b = 0; b < region.size(); ++b) sum[region[b]] += p[b], count[region[b]] += 1;
  for (std::size_t b = 0; b < region.size(); ++b) p[b] -= sum[region[b]] / count[region[b]];
}

// The fixed point of p = G(p) by Anderson's method (Walker & Ni 2011): the next p is G of the mean of the
// last ones, weighted (weights of sum 1) for the least change. Plain iteration creeps where two chambers are
// joined by a hole.
class AndersonMixing {
public:
  AndersonMixing(Eigen::Index size, int memory)
      : changes_(size, memory), images_(size, memory), products_(memory, memory) {}

  // From p and G(p), the next p.
  Eigen::VectorXd next(const Eigen::VectorXd& p, const Eigen::VectorXd& image) {
    const Eigen::VectorXd change = image - p;
    const double length = calls_ > 0 ? (change - lastChange_).norm() : 0;
    if (length > 0) replaceOldest((change - lastChange_) / length, (image - lastImage_) / length);
    lastChange_ = change, lastImage_ = image, ++calls_;
    if (known_ == 0) return image;
    const Eigen::VectorXd weights = products_.topLeftCorner(known_, known_)
                                        .completeOrthogonalDecomposition()
                                        .solve(changes_.leftCols(known_).transpose() * change);
    return image - images_.leftCols(known_) * weights;
  }

private:
  void replaceOldest(const Eigen::VectorXd& change, const Eigen::VectorXd& image) {
    const int column = int(oldest_++ % changes_.cols());
    known_ = std::max(known_, column + 1);
    changes_.col(column) = change;
    images_.col(column) = image;
    for (int c = 0; c < known_; ++c)
      products_(c, column) = products_(column, c) = changes_.col(c).dot(change);
  }
  Eigen::MatrixXd changes_, images_, products_;
  Eigen::VectorXd lastChange_, lastImage_;
  int calls_ = 0, known_ = 0, oldest_ = 0;
};

// Every node's pressure from that of the boundary: its sum and number of passes, two for a line used both
// ways.
struct Sums {
  std::vector<double> pressure;
  std::vector<std::uint32_t> passes;

  void add(const Field& field, const Lines& lines, const Eigen::VectorXd& boundary) {
    lines.forEachSegment([&](int, const Segment& s) {
      const std::size_t last = s.size - 1;
      const double first = boundary[field.nodes[s.node[0]].boundary],
                   back = boundary[field.nodes[s.node[last]].boundary] - s.total();
      pressure[s.node[0]] += back, ++passes[s.node[0]];
      for (std::size_t m = 1; m < last; ++m) {
        pressure[s.node[m]] += first + back + 2 * s.integral[m];
        passes[s.node[m]] += 2;
      }
      pressure[s.node[last]] += first + s.total(), ++passes[s.node[last]];
    });
  }
};

// A node in a nook that no line has reached takes the mean of what its neighbours say.
void fillMissedNodes(const Field& field, const Sums& sums, std::vector<double>& pressure) {
  std::vector<std::size_t> missed;
  for (std::size_t p = 0; p < field.nodes.size(); ++p)
    if (field.nodes[p].boundary != NoFluid && sums.passes[p] == 0) missed.push_back(p);
  std::vector<char> known(missed.empty() ? 0 : field.nodes.size(), 0);
  for (std::size_t p = 0; p < known.size(); ++p) known[p] = sums.passes[p] > 0;
  for (bool more = true; more && !missed.empty();) {
    std::vector<std::size_t> still;
    for (std::size_t p : missed) {
      double sum = 0, count = 0;
      for (int a = 0; a < 3; ++a) {
        const int i = int(p / field.stride[a] % field.grid.n[a]);
        if (const std::size_t q = p - field.stride[a]; i > 0 && known[q])
          sum += pressure[q] + field.nodes[q].step[a], ++count;
        if (const std::size_t q = p + field.stride[a]; i + 1 < field.grid.n[a] && known[q])
          sum += pressure[q] - field.nodes[p].step[a], ++count;
      }
      if (count > 0)
        pressure[p] = sum / count, known[p] = 1;
      else
        still.push_back(p);
    }
    more = still.size() < missed.size();
    missed.swap(still);
  }
}

void check(const PressureProblem& problem, const ParallelLineOptions& options) {
  if (options.order != 2 && options.order != 4)
    throw std::invalid_argument("the order of integration is " + std::to_string(options.order) +
                                "; it must be 2 or 4");
  if (options.directions < 12 || options.directions > 163842)
    throw std::invalid_argument("the number of directions is " + std::to_string(options.directions) +
                                "; it must be 12 to 163842");
  if (!(options.lineSpacing >= 0)) throw std::invalid_argument("the line spacing must not be negative");
  if (!(options.tolerance > 0)) throw std::invalid_argument("the tolerance must be greater than 0");
  if (options.maximumIterations < 1) throw std::invalid_argument("at least one iteration is needed");
  if (problem.grid.size() >= std::size_t(std::numeric_limits<std::int32_t>::max()))
    throw std::invalid_argument("the grid has too many nodes for integration along lines (2^31 or more)");
  for (std::size_t p = 0; p < problem.grid.size(); ++p)
    if (problem.isFluid(p)) return;
  throw std::invalid_argument("no node holds fluid: all of the image is masked or empty");
}

} // namespace

std::vector<std::array<double, 3>> icosphereDirections(int directions) {
  int n = 1;
  while (10 * n * n + 2 < directions) ++n;
  // Any rotation that brings no direction near an axis or a diagonal of the grid
  const Eigen::AngleAxisd tilt(0.6180339887, Vector3d(0.48, 0.31, 0.82).normalized());
  std::vector<std::array<double, 3>> out;
  for (const Vector3d& point : GeodesicSphere(n).points) {
    const Vector3d e = tilt * point;
    if (e.z() > 0) out.push_back({e.x(), e.y(), e.z()});
  }
  return out;
}

PressureSolution parallelLinePressure(const PressureProblem& problem, const ParallelLineOptions& options,
                                      const Progress& progress) {
  check(problem, options);
  PressureSolution out;
  if ((out.aborted = !goOn(progress, 0))) return out;
  const double spacing = options.lineSpacing > 0 ? options.lineSpacing : smallestSpacing(problem.grid);
  const Field field(problem, options.order, spacing);
  const AllLines lines(field, options.directions, spacing);
  const auto aborted = [&](double fraction) { return out.aborted = !goOn(progress, fraction); };

  BoundaryEquation equation(field.boundary.size());
  for (int d = 0; d < lines.directions(); ++d) {
    if (aborted(0.4 * d / lines.directions())) return out;
    equation.add(field, lines[d]);
  }
  if ((out.aborted = !equation.finish(part(progress, 0.4, 0.45)))) return out;

  FluidRegions regions = fluidRegions(problem.grid, problem.mask);
  std::vector<int> region;
  for (std::size_t p : field.boundary) region.push_back(regions.region[p]);
  Eigen::VectorXd boundary = Eigen::VectorXd::Zero(field.boundary.size()), image(boundary.size());
  AndersonMixing mixing(boundary.size(), Memory);
  out.residual = std::numeric_limits<double>::infinity();
  while (out.iterations < options.maximumIterations && out.residual > options.tolerance) {
    const double from = 0.45 + 0.15 * out.iterations / options.maximumIterations;
    out.aborted = !equation.apply(boundary, image, part(progress, from, from));
    if (out.aborted) return out;
    removeMeans(region, regions.count, image);
    const double size = image.norm();
    out.residual = size > 0 ? (image - boundary).norm() / size : 0;
    boundary = mixing.next(boundary, image);
    ++out.iterations;
  }

  Sums sums{std::vector<double>(problem.grid.size(), 0), std::vector<std::uint32_t>(problem.grid.size(), 0)};
  for (int d = 0; d < lines.directions(); ++d) {
    if (aborted(0.6 + 0.4 * d / lines.directions())) return out;
    sums.add(field, lines[d], boundary);
  }
  std::vector<double>& pressure = sums.pressure;
  for (std::size_t p = 0; p < pressure.size(); ++p)
    if (sums.passes[p] > 0) pressure[p] /= sums.passes[p];
  fillMissedNodes(field, sums, pressure);
  removeRegionMeans(regions, pressure.data());
  out.pressure.assign(pressure.begin(), pressure.end());
  out.region = std::move(regions.region);
  out.regions = regions.count;
  return out;
}

} // namespace rimflow
