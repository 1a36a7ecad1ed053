#include "FluidRegions.h"

#include <numeric>

namespace rimflow {
namespace {

// A stretch of fluid nodes along x, [first, last] in the field
struct Run {
  std::size_t first, last;
};

// The sets of runs that hang together (union-find with path halving)
class Sets {
public:
  explicit Sets(std::size_t n) : parent_(n) { std::iota(parent_.begin(), parent_.end(), 0); }
  int find(int a) {
    while (parent_[a] != a) a = parent_[a] = parent_[parent_[a]];
    return a;
  }
  void join(int a, int b) { parent_[find(a)] = find(b); }

private:
  std::vector<int> parent_;
};

// Joins the runs of two rows that touch; `offset` nodes lie between the rows.
void joinRows(const std::vector<Run>& runs, int a, int aEnd, int b, int bEnd, std::size_t offset,
              Sets& sets) {
  while (a < aEnd && b < bEnd) {
    if (runs[a].first + offset <= runs[b].last && runs[b].first <= runs[a].last + offset) sets.join(a, b);
    runs[a].last + offset < runs[b].last ? ++a : ++b;
  }
}

} // namespace

FluidRegions fluidRegions(const Grid& grid, const unsigned char* mask) {
  FluidRegions out;
  const int nx = grid.n[0];
  const std::size_t rows = std::size_t(grid.n[1]) * grid.n[2];
  if (!mask) {
    out.region.assign(grid.size(), 0);
    out.count = grid.size() > 0;
    return out;
  }
  std::vector<Run> runs;
  std::vector<int> rowStart(rows + 1, 0);
  for (std::size_t r = 0; r < rows; ++r) {
    const std::size_t start = r * nx, end = start + nx;
    for (std::size_t p = start; p < end; ++p) {
      if (mask[p]) continue;
      const std::size_t first = p;
      while (p + 1 < end && !mask[p + 1]) ++p;
      runs.push_back({first, p});
    }
    rowStart[r + 1] = int(runs.size());
  }
  Sets sets(runs.size());
  for (std::size_t r = 0; r < rows; ++r) {
    const auto join = [&](std::size_t next) {
      joinRows(runs, rowStart[r], rowStart[r + 1], rowStart[next], rowStart[next + 1], (next - r) * nx, sets);
    };
    if ((r + 1) % grid.n[1] != 0) join(r + 1);
    if (r + grid.n[1] < rows) join(r + grid.n[1]);
  }

  std::vector<std::size_t> nodes(runs.size(), 0);
  std::vector<int> roots;
  for (std::size_t a = 0; a < runs.size(); ++a) {
    const int root = sets.find(int(a));
    if (nodes[root] == 0) roots.push_back(root);
    nodes[root] += runs[a].last - runs[a].first + 1;
  }
  std::stable_sort(roots.begin(), roots.end(), [&](int a, int b) { return nodes[a] > nodes[b]; });
  std::vector<int> label(runs.size(), -1);
  for (std::size_t i = 0; i < roots.size(); ++i) label[roots[i]] = int(i);
  out.count = int(roots.size());
  out.region.assign(grid.size(), -1);
  for (std::size_t a = 0; a < runs.size(); ++a)
    std::fill(out.region.begin() + runs[a].first, out.region.begin() + runs[a].last + 1,
              label[sets.find(int(a))]);
  return out;
}

void removeRegionMeans(const FluidRegions& regions, double* field) {
  std::vector<double> sum(regions.count, 0);
  std::vector<std::size_t> nodes(regions.count, 0);
  for (std::size_t p = 0; p < regions.region.size(); ++p)
    if (const int r = regions.region[p]; r >= 0) sum[r] += field[p], ++nodes[r];
  for (int r = 0; r < regions.count; ++r) sum[r] /= double(nodes[r]);
#pragma omp parallel for schedule(static)
  for (std::size_t p = 0; p < regions.region.size(); ++p) {
    const int r = regions.region[p];
    field[p] = r >= 0 ? field[p] - sum[r] : 0;
  }
}

} // namespace rimflow
