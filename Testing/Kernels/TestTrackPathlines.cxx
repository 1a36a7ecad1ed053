// Breaks when a pathline joins what a gap separates, loses a track that ended, or when a selection splits a
// track.
#include "SnapshotCache.h"
#include "TrackPathlines.h"

#include <gtest/gtest.h>
#include <map>
#include <random>
#include <set>

using namespace rimflow;

namespace {
// The x of a point tells its id and snapshot.
TrackSnapshot snapshot(int k, const std::vector<std::int64_t>& ids, bool acceleration = false) {
  TrackSnapshot s;
  for (const std::int64_t id : ids) {
    for (const float x : {float(100 * id + k), float(id), float(k)}) s.position.push_back(x);
    for (const float u : {float(id), 1.f, 2.f}) s.velocity.push_back(u);
    if (acceleration)
      for (const float a : {float(id), 3.f, 4.f}) s.acceleration.push_back(a);
    s.trackId.push_back(id);
  }
  s.further = {{"Extra", std::vector<double>(ids.size(), k)}};
  return s;
}
std::vector<float> xOf(const Pathlines& p, std::size_t line) {
  std::vector<float> x;
  for (auto i = p.offsets[line]; i < p.offsets[line + 1]; ++i)
    x.push_back(p.points.position[std::size_t(3 * i)]);
  return x;
}
Pathlines build(const std::vector<TrackSnapshot>& snapshots, const TrackSelection& selection = {}) {
  PathlineBuilder builder(selection);
  for (std::size_t k = 0; k < snapshots.size(); ++k)
    builder.addIds(snapshots[k].trackId, 10 + 0.5 * double(k));
  for (const TrackSnapshot& s : snapshots) EXPECT_TRUE(builder.addParticles(s));
  return builder.finish();
}
Pathlines build(const std::vector<std::vector<std::int64_t>>& ids, const TrackSelection& selection = {}) {
  std::vector<TrackSnapshot> snapshots;
  for (std::size_t k = 0; k < ids.size(); ++k) snapshots.push_back(snapshot(int(k), ids[k]));
  return build(snapshots, selection);
}
} // namespace

TEST(TrackPathlines, OneLinePerUnbrokenTrack) {
  //                          7 goes on, 3 ends, 5 has a gap, 9 has just begun
  const Pathlines p = build({{7, 3, 5}, {3, 7}, {5, 7}, {9, 7, 5}});
  ASSERT_EQ(p.offsets.size(), 6u);
  EXPECT_EQ(p.singles, 2u);
  EXPECT_EQ(p.trackId, (std::vector<std::int64_t>{5, 9, 7, 3, 5}));
  EXPECT_EQ(xOf(p, 0), (std::vector<float>{500}));
  EXPECT_EQ(xOf(p, 1), (std::vector<float>{903}));
  EXPECT_EQ(xOf(p, 2), (std::vector<float>{700, 701, 702, 703}));
  EXPECT_EQ(xOf(p, 3), (std::vector<float>{300, 301}));
  EXPECT_EQ(xOf(p, 4), (std::vector<float>{502, 503}));
  for (std::size_t i = 0; i < p.time.size(); ++i) {
    EXPECT_EQ(p.time[i], 10 + 0.5 * double(p.points.position[3 * i + 2]));
    EXPECT_EQ(p.points.velocity[3 * i], float(p.points.trackId[i]));
    EXPECT_EQ(p.points.further[0].values[i], p.points.position[3 * i + 2]);
  }
}

TEST(TrackPathlines, AnEmptySnapshotBreaksAllTracks) {
  const Pathlines p = build({{1, 2}, {}, {1, 2}});
  EXPECT_EQ(p.singles, 4u);
}

TEST(TrackPathlines, ParticlesWithoutTrackAndDuplicates) {
  const Pathlines p = build({{-1, 4, -1, 4}, {4}});
  ASSERT_EQ(p.trackId, (std::vector<std::int64_t>{4}));
  EXPECT_EQ(p.duplicates, 1u);
  EXPECT_EQ(xOf(p, 0), (std::vector<float>{400, 401}));
  EXPECT_TRUE(build(std::vector<TrackSnapshot>()).trackId.empty());
  EXPECT_EQ(build(std::vector<TrackSnapshot>()).offsets, std::vector<std::int64_t>{0});
  PathlineBuilder shrunk({});
  shrunk.addIds({1, 2}, 0);
  EXPECT_FALSE(shrunk.addParticles(snapshot(0, {1})));
}

TEST(TrackPathlines, AnArrayThatOnlySomeSnapshotsHaveIsNamed) {
  for (const bool first : {true, false}) {
    TrackSnapshot bare = snapshot(1, {1}, !first);
    bare.further.clear();
    const Pathlines p = build({snapshot(0, {1}, first), bare, snapshot(2, {}, false)});
    EXPECT_TRUE(p.points.acceleration.empty());
    EXPECT_EQ(p.dropped, (std::vector<std::string>{"Acceleration", "Extra"}));
    EXPECT_EQ(p.points.velocity.size(), 6u);
    EXPECT_TRUE(p.points.further.empty());
  }
  const TrackSnapshot late = snapshot(1, {1});
  TrackSnapshot bare = snapshot(0, {1});
  bare.further.clear();
  EXPECT_EQ(build({bare, late}).dropped, std::vector<std::string>{"Extra"});
}

// Against a plain map from id to snapshots, with random drop-out.
TEST(TrackPathlines, AgreesWithAPlainSearchOnRandomTracks) {
  std::mt19937 random(3);
  std::vector<std::vector<std::int64_t>> ids(12);
  std::map<std::int64_t, std::set<int>> seen;
  for (int k = 0; k < 12; ++k) {
    for (std::int64_t id = 0; id < 500; ++id)
      if (random() % 5) {
        ids[std::size_t(k)].push_back(id * 99991 % (std::int64_t(1) << 40));
        seen[ids[std::size_t(k)].back()].insert(k);
      }
    std::shuffle(ids[std::size_t(k)].begin(), ids[std::size_t(k)].end(), random);
  }
  std::set<std::pair<std::int64_t, std::vector<double>>> expected, found;
  for (const auto& [id, when] : seen) {
    std::vector<double> run;
    for (int k = 0; k <= 12; ++k)
      if (when.count(k))
        run.push_back(10 + 0.5 * k);
      else if (!run.empty()) {
        expected.insert({id, run});
        run.clear();
      }
  }
  const Pathlines p = build(ids);
  for (std::size_t l = 0; l + 1 < p.offsets.size(); ++l)
    found.insert({p.trackId[l], {p.time.begin() + p.offsets[l], p.time.begin() + p.offsets[l + 1]}});
  EXPECT_EQ(found, expected);
  EXPECT_EQ(p.trackId.size(), expected.size());
}

TEST(TrackSelection, KeepsOrLeavesWholeTracks) {
  TrackStatistics tracks;
  tracks.add(0, {1, 2, 3, 4, 10});
  tracks.add(1, {4, 2, 2, 10, -1});
  tracks.add(2, {10, 4});
  tracks.add(4, {1});
  EXPECT_EQ(tracks.of(1).length, 2);
  EXPECT_EQ(tracks.of(1).first, 0);
  EXPECT_EQ(tracks.of(1).last, 4);
  EXPECT_EQ(tracks.of(2).length, 2); // twice in one snapshot counts once
  EXPECT_EQ(tracks.of(2).last, 1);
  EXPECT_EQ(tracks.of(10).length, 3);
  for (const std::int64_t nowhere : {11, -1}) {
    EXPECT_EQ(tracks.of(nowhere).length, 0);
    EXPECT_EQ(tracks.of(nowhere).first, -1);
  }
  const auto kept = [&](TrackSelection s) {
    s.tracks = &tracks;
    std::vector<std::int64_t> ids;
    const TrackSnapshot all = snapshot(0, {1, 2, 3, 4, 10, -1});
    const TrackSnapshot chosen = takeRows(all, selectedRows(all, s));
    EXPECT_EQ(chosen.position.size(), 3 * chosen.trackId.size());
    EXPECT_EQ(chosen.further[0].values.size(), chosen.trackId.size());
    return chosen.trackId;
  };
  using Ids = std::vector<std::int64_t>;
  EXPECT_EQ(kept({}), (Ids{1, 2, 3, 4, 10, -1}));
  EXPECT_EQ(kept({2, -1, -1, 1, nullptr}), (Ids{2, 4, 10})); // -1 is in row 5
  EXPECT_EQ(kept({1, 2, 4, 1, nullptr}), (Ids{2, 3, 4}));
  EXPECT_EQ(kept({1, 3, -1, 1, nullptr}), (Ids{3, 4, 10}));
  EXPECT_EQ(kept({1, -1, -1, 2, nullptr}), (Ids{1, 2, 4, 10}));
  EXPECT_EQ(kept({1, -1, -1, 3, nullptr}), (Ids{4, 10}));
  EXPECT_TRUE(TrackSelection{}.keepsAll());
}

TEST(TrackSelection, ScatteredIdsCannotTakeAllMemory) {
  TrackStatistics tracks;
  std::mt19937_64 random(1);
  const auto addMany = [&] {
    for (int k = 0; k < 2000; ++k) {
      std::vector<std::int64_t> ids(1000);
      for (auto& id : ids) id = std::int64_t(random() >> 1);
      tracks.add(k, ids);
    }
  };
  EXPECT_THROW(addMany(), std::runtime_error);
}

TEST(SnapshotCache, KeepsTheLatestWithinItsLimit) {
  SnapshotCache cache;
  const auto make = [](int k) { return std::make_shared<TrackSnapshot>(snapshot(k, {1, 2, 3})); };
  const std::size_t one = make(0)->bytes();
  cache.setLimit(2 * one);
  cache.add(0, make(0));
  cache.add(1, make(1));
  EXPECT_TRUE(cache.find(0));
  cache.add(2, make(2)); // 1 is the one not used for longest
  EXPECT_FALSE(cache.find(1));
  EXPECT_TRUE(cache.find(0) && cache.find(2));
  EXPECT_EQ(cache.bytes(), 2 * one);
  cache.setLimit(one - 1);
  cache.add(3, make(3));
  EXPECT_EQ(cache.bytes(), 0u);
}
