// A camera made ready for the kernels, and which chunks it can see.
#pragma once
#include <algorithm>
#include <cmath>

#include "splat_types.h"

namespace coin3d {

inline SplatView splat_view(const SplatCamera& camera) {
  SplatView v;
  for (int i = 0; i < 9; ++i) v.r[i] = static_cast<float>(camera.rotation[i]);
  for (int i = 0; i < 3; ++i) v.position[i] = static_cast<float>(camera.position[i]);
  for (int i = 0; i < 6; ++i) v.k[i] = static_cast<float>(camera.K[i]);
  for (int i = 0; i < 4; ++i) v.limits[i] = static_cast<float>(camera.limits[i]);
  v.width = static_cast<float>(camera.width);
  v.height = static_cast<float>(camera.height);
  const double* k = camera.K;
  const double det = k[0] * k[4] - k[1] * k[3];
  v.g00 = static_cast<float>(k[0] * k[0] + k[1] * k[1]);
  v.g01 = static_cast<float>(k[0] * k[3] + k[1] * k[4]);
  v.g11 = static_cast<float>(k[3] * k[3] + k[4] * k[4]);
  v.det_g = static_cast<float>(det * det);
  v.trace_g = v.g00 + v.g11;
  // A splat reaches over the image's side by at most sqrt(cutoff (blur + (std / z)^2 (G + k k^T))) pixels. Multiplied by z
  // and bounded by the sum of both roots, that is linear in z and std, so a chunk's sphere can be tested against it.
  const double blur = std::sqrt(kCutoff * kBlur) + 0.02;
  for (int axis = 0; axis < 2; ++axis) {
    const double* row = k + 3 * axis;
    double steepest = 0;
    for (int corner = 0; corner < 4; ++corner) {
      const double x = camera.limits[corner & 1], y = camera.limits[2 + (corner >> 1)];
      steepest = std::max(steepest, std::abs(row[0] * x + row[1] * y));
    }
    const double reach = std::sqrt(kCutoff * (row[0] * row[0] + row[1] * row[1] + steepest * steepest));
    const double size = static_cast<double>(axis ? camera.height : camera.width);
    for (int end = 0; end < 2; ++end) {
      const double sign = end ? -1 : 1;
      const double p0 = sign * row[0], p1 = sign * row[1], p2 = (end ? size : 0) + sign * row[2] + blur;
      float* plane = v.planes[2 * axis + end];
      plane[0] = static_cast<float>(p0);
      plane[1] = static_cast<float>(p1);
      plane[2] = static_cast<float>(p2);
      plane[3] = static_cast<float>(std::sqrt(p0 * p0 + p1 * p1 + p2 * p2) * 1.0001);
      plane[4] = static_cast<float>(reach * 1.0001);
    }
  }
  return v;
}

// False only if no splat of the chunk can touch the image. Written so that a number that overflowed counts as seen.
inline bool sees_chunk(const SplatView& v, const float* bounds) {
  const float ex = bounds[0] - v.position[0], ey = bounds[1] - v.position[1], ez = bounds[2] - v.position[2];
  const float x = v.r[0] * ex + v.r[1] * ey + v.r[2] * ez;
  const float y = v.r[3] * ex + v.r[4] * ey + v.r[5] * ez;
  const float z = v.r[6] * ex + v.r[7] * ey + v.r[8] * ez;
  bool hidden = z + bounds[3] <= kNear;
  for (const auto& p : v.planes) hidden |= p[0] * x + p[1] * y + p[2] * z + p[3] * bounds[3] + p[4] * bounds[4] < 0;
  return !hidden;
}

}  // namespace coin3d
