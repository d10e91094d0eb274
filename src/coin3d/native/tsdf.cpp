#include "tsdf.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "parallel.h"

namespace coin3d {
namespace {

// Bounds the memory of the (block, point) pairs.
constexpr int64_t kChunk = int64_t{1} << 18;

// The voxels one point changes, layer by layer across the main axis.
struct Line {
  int a, b, c;     // main axis and the two others
  double p[3];     // the point in voxels; voxel i has its centre at i + 0.5
  double d[3];     // unit vector to free space
  int64_t first, last;

  Line(const double* point, const float* toward, double per_voxel, double truncation) {
    for (int i = 0; i < 3; ++i) p[i] = point[i] * per_voxel, d[i] = toward[i];
    a = std::fabs(d[0]) >= std::fabs(d[1]) ? 0 : 1;
    if (std::fabs(d[2]) > std::fabs(d[a])) a = 2;
    b = (a + 1) % 3, c = (a + 2) % 3;
    const double reach = truncation * std::fabs(d[a]);
    first = static_cast<int64_t>(std::ceil(p[a] - reach - 0.5));
    last = static_cast<int64_t>(std::floor(p[a] + reach - 0.5));
  }
  // The voxel of a layer, and the distance along the main axis.
  double layer(int64_t k, int64_t* vb, int64_t* vc) const {
    const double along = static_cast<double>(k) + 0.5 - p[a], t = along / d[a];
    *vb = static_cast<int64_t>(std::floor(p[b] + t * d[b]));
    *vc = static_cast<int64_t>(std::floor(p[c] + t * d[c]));
    return along;
  }
  double distance(double along, int64_t vb, int64_t vc) const {
    return along * d[a] + (static_cast<double>(vb) + 0.5 - p[b]) * d[b] + (static_cast<double>(vc) + 0.5 - p[c]) * d[c];
  }
};

// Calls visit(block key) once for every block the line touches.
template <typename Visit>
void touched_blocks(const Line& line, int spread, const Visit& visit) {
  uint64_t seen[64];  // enough for kMaxTruncation and kMaxSpread: 5 slabs of at most 3 x 3 blocks
  int count = 0;
  int64_t xyz[3], vb, vc;
  for (int64_t k = line.first; k <= line.last; ++k) {
    line.layer(k, &vb, &vc);
    xyz[line.a] = k >> 3;
    for (xyz[line.b] = (vb - spread) >> 3; xyz[line.b] <= (vb + spread) >> 3; ++xyz[line.b])
      for (xyz[line.c] = (vc - spread) >> 3; xyz[line.c] <= (vc + spread) >> 3; ++xyz[line.c]) {
        const uint64_t key = block_key(xyz[0], xyz[1], xyz[2]);
        // new ones come last, so the search from the end is short
        int i = count - 1;
        while (i >= 0 && seen[i] != key) --i;
        if (i >= 0) continue;
        seen[count++] = key;
        visit(key);
      }
  }
}

}  // namespace

TsdfVolume::TsdfVolume(double voxel_m, double truncation_m)
    : per_voxel_(1.0 / voxel_m), truncation_(truncation_m / voxel_m), voxel_m_(voxel_m) {}

void TsdfVolume::integrate(const double* points, const float* toward, const float* weight, int64_t n, int spread, int threads) {
  const double farthest = static_cast<double>(kMaxBlock) * kBlockSide;
  for (int64_t i = 0; i < 3 * n; ++i)
    // the comparison is false for NaN
    if (!(std::fabs(points[i] * per_voxel_) < farthest))
      throw std::invalid_argument("a point is not finite or lies more than 8 million voxels from the origin");
  for (int64_t i = 0; i < n; ++i) {
    const float* d = toward + 3 * i;
    if (!(std::fabs(d[0] * d[0] + d[1] * d[1] + d[2] * d[2] - 1.f) < 1e-3f))
      throw std::invalid_argument("a direction towards free space does not have length 1");
    if (weight && !(weight[i] >= 0.f && weight[i] < 1e6f)) throw std::invalid_argument("a weight is negative or not finite");
  }
  for (int64_t first = 0; first < n; first += kChunk)
    chunk(points + 3 * first, toward + 3 * first, weight ? weight + first : nullptr, std::min(kChunk, n - first), spread, threads);
}

void TsdfVolume::chunk(const double* points, const float* toward, const float* weight, int64_t n, int spread, int threads) {
  // 1. Which blocks does each point touch? New blocks get numbers per part first.
  struct Part {
    BlockMap fresh;
    std::vector<Pair> pairs;  // block < 0: -1 - row in `fresh`
  };
  const int64_t parts = std::max<int64_t>(1, std::min<int64_t>(threads, n));
  std::vector<Part> part(parts);
  parallel_ranges(parts, threads, [&](int64_t p0, int64_t p1) {
    for (int64_t p = p0; p < p1; ++p) {
      part[p].pairs.reserve(2 * n / parts);
      uint64_t last_key = ~uint64_t{0};
      int32_t last_row = 0;
      for (int64_t i = n * p / parts; i < n * (p + 1) / parts; ++i)
        touched_blocks(Line(points + 3 * i, toward + 3 * i, per_voxel_, truncation_), spread, [&](uint64_t key) {
          if (key != last_key) {
            last_row = map_.find(key);
            if (last_row < 0) last_row = -1 - part[p].fresh.insert(key);
            last_key = key;
          }
          part[p].pairs.push_back({last_row, static_cast<int32_t>(i)});
        });
    }
  });
  // 2. Number new blocks in the order of the points, whatever the parts were, and sort the pairs by block, points in order.
  std::vector<std::vector<int32_t>> row_of(parts);
  for (int64_t p = 0; p < parts; ++p)
    for (uint64_t key : part[p].fresh.keys()) row_of[p].push_back(map_.insert(key));
  while (static_cast<int64_t>(slabs_.size()) * kSlab < map_.size()) slabs_.emplace_back(new Block[kSlab]());
  std::vector<int64_t> start(map_.size() + 1, 0);
  for (int64_t p = 0; p < parts; ++p)
    for (Pair& pair : part[p].pairs) {
      if (pair.block < 0) pair.block = row_of[p][-1 - pair.block];
      ++start[pair.block + 1];
    }
  for (int64_t r = 0; r < map_.size(); ++r) start[r + 1] += start[r];
  std::vector<int32_t> point_of(start.back());
  std::vector<int64_t> next(start.begin(), start.end() - 1);
  for (const Part& p : part)
    for (const Pair& pair : p.pairs) point_of[next[pair.block]++] = pair.point;
  // 3. Each block belongs to one thread.
  parallel_ranges(start.back(), threads, [&](int64_t begin, int64_t end) {
    int64_t row = std::lower_bound(start.begin(), start.end(), begin) - start.begin();
    for (; row < map_.size() && start[row] < end; ++row) {
      if (start[row] == start[row + 1]) continue;
      int32_t origin[3];
      block_of_key(map_.keys()[row], origin);
      Block& out = block(row);
      for (int64_t j = start[row]; j < start[row + 1]; ++j) {
        const int64_t i = point_of[j];
        const Line line(points + 3 * i, toward + 3 * i, per_voxel_, truncation_);
        const float w = weight ? weight[i] : 1.f;
        const int64_t low_a = int64_t{origin[line.a]} * 8, low_b = int64_t{origin[line.b]} * 8, low_c = int64_t{origin[line.c]} * 8;
        int64_t xyz[3], vb, vc;
        for (int64_t k = std::max(line.first, low_a); k <= std::min(line.last, low_a + 7); ++k) {
          const double along = line.layer(k, &vb, &vc);
          xyz[line.a] = k;
          for (xyz[line.b] = std::max(vb - spread, low_b); xyz[line.b] <= std::min(vb + spread, low_b + 7); ++xyz[line.b])
            for (xyz[line.c] = std::max(vc - spread, low_c); xyz[line.c] <= std::min(vc + spread, low_c + 7); ++xyz[line.c]) {
              const double s = line.distance(along, xyz[line.b], xyz[line.c]);
              if (std::fabs(s) > truncation_) continue;
              const int64_t ob = xyz[line.b] - vb, oc = xyz[line.c] - vc;
              const float wv = w / static_cast<float>(1 + ob * ob + oc * oc);
              const int v = voxel_in_block(xyz[0], xyz[1], xyz[2]);
              out.distance[v] += wv * static_cast<float>(s);
              out.weight[v] += wv;
            }
        }
      }
    }
  });
}

void TsdfVolume::field(float min_weight, int32_t* coords, float* value, int threads) const {
  parallel_ranges(blocks(), threads, [&](int64_t first, int64_t last) {
    for (int64_t r = first; r < last; ++r) {
      block_of_key(map_.keys()[r], coords + 3 * r);
      const Block& in = block(r);
      for (int v = 0; v < kBlockVoxels; ++v) {
        const float w = in.weight[v];
        const bool seen = w > 0.f && w >= min_weight;
        value[r * kBlockVoxels + v] =
            seen ? in.distance[v] / w * static_cast<float>(voxel_m_) : std::numeric_limits<float>::quiet_NaN();
      }
    }
  });
}

}  // namespace coin3d
