// Lift-splat pooling: every pixel spreads its context vector along its ray, weighted by the depth distribution,
// into bird's-eye-view cells. The outer product (pixel x bin x channel) is never stored.
#pragma once
#include <cstdint>

namespace coin3d {

// depth   [pixels, bins]     probability of each depth bin
// context [pixels, channels] feature to lift
// cell    [pixels, bins]     row of `bev` the point falls into, or -1
// bev     [cells, channels]  output, overwritten
void bev_pool_forward(const float* depth, const float* context, const int32_t* cell, float* bev, int64_t pixels, int64_t bins,
                      int64_t channels, int64_t cells, int threads);

// Gradients of the above: grad_depth [pixels, bins] and grad_context [pixels, channels] are overwritten.
void bev_pool_backward(const float* grad_bev, const float* depth, const float* context, const int32_t* cell, float* grad_depth,
                       float* grad_context, int64_t pixels, int64_t bins, int64_t channels, int threads);

}  // namespace coin3d
