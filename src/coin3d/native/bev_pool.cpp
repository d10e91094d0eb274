#include "bev_pool.h"

#include <cstring>

#include "parallel.h"

namespace coin3d {
namespace {

// Each thread owns a range of channels and walks all points in the same order, so the sums are the same for any thread count.
COIN3D_SIMD void splat_channels(const float* depth, const float* context, const int32_t* cell, float* bev, int64_t pixels,
                                int64_t bins, int64_t channels, int64_t first, int64_t last) {
  for (int64_t p = 0; p < pixels; ++p) {
    const float* feature = context + p * channels;
    for (int64_t k = 0; k < bins; ++k) {
      const int32_t row = cell[p * bins + k];
      if (row < 0) continue;
      const float weight = depth[p * bins + k];
      float* out = bev + static_cast<int64_t>(row) * channels;
      for (int64_t c = first; c < last; ++c) out[c] += weight * feature[c];
    }
  }
}

COIN3D_SIMD void gather_pixels(const float* grad_bev, const float* depth, const float* context, const int32_t* cell,
                               float* grad_depth, float* grad_context, int64_t bins, int64_t channels, int64_t first,
                               int64_t last) {
  for (int64_t p = first; p < last; ++p) {
    const float* feature = context + p * channels;
    float* grad_feature = grad_context + p * channels;
    std::memset(grad_feature, 0, sizeof(float) * channels);
    for (int64_t k = 0; k < bins; ++k) {
      const int32_t row = cell[p * bins + k];
      float dot = 0.f;
      if (row >= 0) {
        const float weight = depth[p * bins + k];
        const float* grad = grad_bev + static_cast<int64_t>(row) * channels;
        for (int64_t c = 0; c < channels; ++c) {
          dot += grad[c] * feature[c];
          grad_feature[c] += weight * grad[c];
        }
      }
      grad_depth[p * bins + k] = dot;
    }
  }
}

}  // namespace

void bev_pool_forward(const float* depth, const float* context, const int32_t* cell, float* bev, int64_t pixels, int64_t bins,
                      int64_t channels, int64_t cells, int threads) {
  std::memset(bev, 0, sizeof(float) * cells * channels);
  parallel_ranges(channels, threads, [&](int64_t first, int64_t last) {
    splat_channels(depth, context, cell, bev, pixels, bins, channels, first, last);
  });
}

void bev_pool_backward(const float* grad_bev, const float* depth, const float* context, const int32_t* cell, float* grad_depth,
                       float* grad_context, int64_t pixels, int64_t bins, int64_t channels, int threads) {
  parallel_ranges(pixels, threads, [&](int64_t first, int64_t last) {
    gather_pixels(grad_bev, depth, context, cell, grad_depth, grad_context, bins, channels, first, last);
  });
}

}  // namespace coin3d
