// Truncated signed distance from points that know where their free side is. Positive is free space.
#pragma once
#include <cstdint>
#include <memory>
#include <vector>

#include "block_map.h"

namespace coin3d {

constexpr double kMaxTruncation = 16;  // voxels
constexpr int kMaxSpread = 3;

// One voxel per layer across the main axis of `toward` (its largest component), the one the line through the point passes,
// plus `spread` voxels around it in that layer at weight 1 / (1 + squared offset). The distance of a voxel's centre is measured
// along `toward`; voxels farther than the truncation are left alone. Sums per voxel run in the order of the points, so they are
// the same for any number of threads.
class TsdfVolume {
 public:
  TsdfVolume(double voxel_m, double truncation_m);
  TsdfVolume(const TsdfVolume&) = delete;
  TsdfVolume& operator=(const TsdfVolume&) = delete;

  // points: (n, 3) metres. toward: (n, 3) unit vectors from the surface to free space. weight: (n) or null for ones.
  // Throws std::invalid_argument for points that are not finite or too far out; nothing of the call is kept then.
  void integrate(const double* points, const float* toward, const float* weight, int64_t n, int spread, int threads);

  int64_t blocks() const { return map_.size(); }
  int64_t bytes() const { return static_cast<int64_t>(slabs_.size()) * kSlab * sizeof(Block); }
  // coords: (blocks, 3). value: (blocks, 512) mean distance in metres, NaN where the weight is below the least.
  void field(float min_weight, int32_t* coords, float* value, int threads) const;

 private:
  struct Block {
    float distance[kBlockVoxels];  // sum of weight times distance in voxels
    float weight[kBlockVoxels];
  };
  struct Pair {
    int32_t block, point;
  };
  static constexpr int64_t kSlab = 64;

  void chunk(const double* points, const float* toward, const float* weight, int64_t n, int spread, int threads);
  Block& block(int64_t row) { return slabs_[row / kSlab][row % kSlab]; }
  const Block& block(int64_t row) const { return slabs_[row / kSlab][row % kSlab]; }

  double per_voxel_, truncation_;  // truncation in voxels
  double voxel_m_;
  BlockMap map_;
  std::vector<std::unique_ptr<Block[]>> slabs_;  // blocks never move, so growing copies nothing
};

}  // namespace coin3d
